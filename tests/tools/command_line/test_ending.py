import os
import subprocess
import sys
from pathlib import Path

import pytest

from tbmslam.errors import TbmSlamError
from tools.command_line.ending import ended

ROOT = Path(__file__).resolve().parents[3]


def raising(error):
    def work():
        raise error

    return work


def test_what_a_program_returns_is_its_exit_code(capsys):
    assert [ended("merge", lambda: 3), ended("merge", lambda: None)] == [3, 0]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (TbmSlamError("x.bag: is empty"), "merge: x.bag: is empty"),
        (OSError(36, "File name too long", "x"), "merge: x: File name too long: check that name, or choose another"),
        (MemoryError(), "merge: memory has run out: merge fewer maps"),
    ],
)
def test_a_known_error_is_one_line_and_with_debug_an_error(capsys, error, line):
    assert ended("merge", raising(error), out_of_memory="merge fewer maps") == 1
    assert capsys.readouterr().err == f"{line}\n"
    with pytest.raises(type(error)):
        ended("merge", raising(error), debug=True)


def test_with_debug_the_systems_error_of_something_else_is_shown_as_well():
    with pytest.raises(BrokenPipeError):
        ended("merge", raising(BrokenPipeError()), debug=True)


def test_a_mistake_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        ended("merge", raising(ZeroDivisionError()))


def printed_into(place, *words):
    """Run merge with its output going to a place; return its exit code and what it said."""
    command = [sys.executable, str(ROOT / "tools/merge.py"), *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(  # noqa: S603 - a fixed command
        command, stdout=place, stderr=subprocess.PIPE, text=True, env=environment, check=False
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
@pytest.mark.parametrize("words", [["--print-config"], ["--print-config", "--debug"], ["--help"]], ids=" ".join)
def test_a_full_disk_for_what_is_printed_is_one_line(words):
    with Path("/dev/full").open("w") as full:
        done = printed_into(full, *words)
    said = "merge: No space left on device: check what is read and printed\n"
    assert (done.returncode, done.stderr) == (1, said)


def test_a_reader_that_has_gone_is_one_line():
    reader, writer = os.pipe()
    os.close(reader)
    done = printed_into(writer, "--print-config")
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "merge: Broken pipe: check what is read and printed\n")


def test_who_has_neither_output_nor_errors_gets_the_exit_code():
    closing = "import os, sys; os.close(1); os.close(2); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", closing, str(ROOT / "tools/merge.py")]
    for more, code in ((["--print-config"], 0), (["a.npz", "b.npz", "-o", "merged"], 1)):
        assert subprocess.run([*words, *more], env=environment, check=False).returncode == code  # noqa: S603
