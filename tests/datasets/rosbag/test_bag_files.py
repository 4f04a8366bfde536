import bz2
import gzip
import lzma

import numpy as np
import pytest

from datasets import open_recording
from datasets.rosbag.bag_files import is_ros1, storage_files, unpacked
from tests.processes import python


def test_files_are_distinguished_and_sorted(tmp_path):
    for name in ("run_10.db3", "run_9.db3", "run.db3", "metadata.yaml", "run_1.db3.zstd"):
        (tmp_path / name).touch()
    assert [path.name for path in storage_files(tmp_path)] == ["run.db3", "run_9.db3", "run_10.db3"]
    (tmp_path / "\u00b29.db3").touch()  # a digit that is no number
    assert len(storage_files(tmp_path)) == 4
    (tmp_path / "x").write_bytes(b"#ROSBAG V2.0\n")
    assert is_ros1(tmp_path / "x")
    assert not is_ros1(tmp_path / "run.db3")
    assert not is_ros1(tmp_path)


PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


@pytest.fixture
def bag(script, tmp_path):
    """Return a writer of a 10 s drive, whose scans do not compress away."""

    def write(kind="none"):
        noise = np.random.default_rng(1).uniform(1.0, 20.0, (100, 4000))
        script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 111.0)
        for k in range(100):
            script.scan(100.5 + 0.1 * k, noise[k], step=0.001)
        path = script.in_time_order().write(tmp_path / ("run.bag" if kind == "none" else "run"), kind)
        return path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")

    return write


def stamps_of(path):
    recording = open_recording([path])
    return [reading.scan.stamp for reading in recording], recording.counts


@pytest.mark.parametrize(("kind", "ending"), [("none", ".gz"), ("none", ".bz2"), ("none", ".xz"), ("mcap", ".gz")])
def test_a_packed_bag_is_read_as_the_bag(bag, kind, ending):
    plain = bag(kind)
    packed = plain.with_name(plain.name + ending)
    packed.write_bytes(PACKERS[ending](plain.read_bytes()))
    expected = stamps_of(plain)[0]
    assert len(expected) == 100
    assert stamps_of(packed)[0] == expected
    assert unpacked(packed) is unpacked(packed)
    assert unpacked(plain).path == plain


@pytest.mark.parametrize("ending", PACKERS)
def test_of_a_cut_file_what_is_there_is_used(bag, ending, caplog):
    plain = bag()
    content = PACKERS[ending](plain.read_bytes())
    packed = plain.with_name("cut.bag" + ending)
    packed.write_bytes(content[: int(len(content) * 0.6)])
    found, _ = stamps_of(packed)
    assert 30 < len(found) < 70
    assert f"cut.bag{ending}: the packed file is cut off" in caplog.text


def test_a_changed_byte_is_reported(bag, caplog):
    """The checksum at the end alone may notice it."""
    plain = bag()
    content = bytearray(gzip.compress(plain.read_bytes(), 0))
    content[len(content) // 2] ^= 1
    packed = plain.with_name("run.bag.gz")
    packed.write_bytes(content)
    assert len(stamps_of(packed)[0]) > 90
    assert "the packed file is damaged (CRC check failed" in caplog.text


PROGRAM = """
import resource, sys
from pathlib import Path
from datasets import DatasetError, open_recording
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
try:
    open_recording([Path(sys.argv[1])])
except DatasetError as error:
    print(error)
"""


COUNTING = """
import sys
from pathlib import Path
from datasets import open_recording
print(sum(1 for _ in open_recording([Path(sys.argv[1])])), *Path(sys.argv[2]).iterdir())
"""


@pytest.fixture
def unpacked_by(bag, tmp_path):
    """Return what a program prints about a packed bag, which leaves no temporary files behind."""
    plain, scratch = bag(), tmp_path / "scratch"
    packed = plain.with_name("run.bag.gz")
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    scratch.mkdir()
    yield lambda program: python("-c", program, packed, scratch, TMPDIR=str(scratch)).stdout
    assert list(scratch.iterdir()) == []


IN_USE = """
import os, sys
from pathlib import Path
from datasets import open_recording
def in_use(*_, **__):
    raise PermissionError(13, "another process uses the file")
print(sum(1 for _ in open_recording([Path(sys.argv[1])])))
os.unlink = in_use
"""


def test_a_temporary_file_that_windows_still_holds_is_no_error(bag, tmp_path):
    packed = tmp_path / "run.bag.gz"
    packed.write_bytes(gzip.compress(bag().read_bytes()))
    done = python("-c", IN_USE, packed, TMPDIR=str(tmp_path))
    assert (done.stdout, done.stderr, done.returncode) == ("100\n", "", 0)


def test_no_room_is_one_line(unpacked_by):
    said = unpacked_by(PROGRAM)
    assert "run.bag.gz: cannot be unpacked into " in said
    assert said.endswith("(File too large): make room, or set TMPDIR to a folder with room\n")


def test_temporary_files_are_there_while_a_program_runs(unpacked_by, tmp_path):
    assert unpacked_by(COUNTING).startswith("100 " + str(tmp_path / "scratch" / "tbmslam-"))
