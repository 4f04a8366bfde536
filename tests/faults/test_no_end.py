"""What is read may be a device, a pipe, a socket, or pass for an empty file: that is told, and never waited for."""

import os
import signal
import socket
from pathlib import Path

import pytest

from datasets import DatasetError, open_recording
from datasets.opening import file_digests, list_recordings
from datasets.synthetic.world.world import WorldError, load_world
from tbmslam.configuration.slam_config import ConfigError
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import RelationsError, read_relations
from tbmslam.io.beesoft_map import read_beesoft_map
from tbmslam.io.map_folder import files_of_map, load_map
from tbmslam.io.map_npz import drive_lengths, read_map_file
from tbmslam.io.ros_map import read_ros_map
from tbmslam.io.tbm_dump import read_tbm_dump
from tbmslam.io.trajectory_file import TumError, read_tum
from tbmslam.map.map_check import MapFileError
from tests.datasets.conftest import BagScript
from tools.benchmarks.strangers import EarlierRunError, _tried_before
from tools.command_line.checksums import NAME, changed_files
from tools.command_line.configuration import read_configuration
from tools.map_pairs.known_pair import PairFileError, load_pair
from tools.mapping.truth_file import TruthFileError
from tools.paper.experiments import load_pairs

NO_FILE, EMPTY = "is a device or a pipe", "is empty"
KERNEL_LOG = Path("/proc/kmsg")
"""Of size 0, and whoever reads it waits for the kernel's next message."""
YAML = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def yaml_of(picture):
    picture.with_name("m.yaml").write_text(YAML)
    return load_map(picture.with_name("m.yaml"))


def folder_of(file):
    return open_recording([file.parent])


READERS = {
    "ROS 1 bag": ("run.bag", lambda file: open_recording([file]), DatasetError),
    "ROS 2 database": ("run.db3", lambda file: open_recording([file]), DatasetError),
    "mcap": ("run.mcap", lambda file: open_recording([file]), DatasetError),
    "database in a folder": ("run/run_0.db3", folder_of, DatasetError),
    "mcap in a folder": ("run/run_0.mcap", folder_of, DatasetError),
    "CARMEN log": ("run.log", lambda file: open_recording([file]), DatasetError),
    "packed CARMEN log": ("run.log.gz", lambda file: open_recording([file]), DatasetError),
    "map.npz": ("map.npz", load_map, MapFileError),
    "npz": ("m.npz", read_map_file, MapFileError),
    "yaml": ("m.yaml", load_map, MapFileError),
    "yaml, its files": ("m.yaml", lambda file: files_of_map(file)[1], (MapFileError, IndexError)),
    "ROS map": ("m.yaml", read_ros_map, MapFileError),
    "picture": ("m.pgm", yaml_of, MapFileError),
    ".tbm_map": ("m.tbm_map", load_map, MapFileError),
    "dump": ("m.tbm_map", read_tbm_dump, MapFileError),
    ".dat": ("m.dat", load_map, MapFileError),
    "Beesoft map": ("m.dat.gz", read_beesoft_map, MapFileError),
    "trajectory": ("t.tum", read_tum, TumError),
    "relations": ("r.relations", read_relations, RelationsError),
    "configuration": ("c.toml", lambda file: read_configuration(None, file), ConfigError),
    "configuration of a folder": ("config.toml", lambda file: read_configuration(None, file.parent), ConfigError),
    "world": ("world.npz", load_world, WorldError),
    "pair of maps": ("pair.npz", load_pair, PairFileError),
    "truth of maps": ("truth.json", lambda file: load_pairs(file.parent, 1, 0.1), TruthFileError),
    "record of strangers": ("s.json", lambda file: _tried_before(file, {}), EarlierRunError),
}


@pytest.fixture(autouse=True)
def _no_waiting():
    """End a test that waits, instead of all of them."""

    def stop(*_):
        raise AssertionError("it is waited for")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def bag_of_one_scan(folder):
    script = BagScript().tf(99.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0).scan(101.0)
    return script.in_time_order().write(folder, "sqlite3")


def put(kind, place):
    """Put something that cannot be read at a place; return what should be said of it."""
    place.parent.mkdir(exist_ok=True)
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as end:
            here = Path.cwd()
            os.chdir(place.parent)  # such a name may not be long
            end.bind(place.name)
            os.chdir(here)
    elif kind == "device":
        place.symlink_to("/dev/zero")
    elif kind == "kernel's log":
        if not os.access(KERNEL_LOG, os.R_OK):
            pytest.skip(f"{KERNEL_LOG} may not be read here, so that nobody waits for it")
        place.symlink_to(KERNEL_LOG)
    else:
        place.touch()
    return NO_FILE if kind in {"pipe", "socket", "device"} else EMPTY


KINDS = ("pipe", "socket", "device", "kernel's log", "empty file")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("what", READERS)
def test_what_has_no_end_or_no_beginning_is_one_line(tmp_path, what, kind):
    name, read, error = READERS[what]
    said = put(kind, tmp_path / name)
    with pytest.raises(error) as raised:
        read(tmp_path / name)
    if isinstance(raised.value, TbmSlamError):
        assert said in str(raised.value)
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize("kind", KINDS)
def test_files_of_a_recording_are_distinguished_without_waiting(tmp_path, kind):
    said = put(kind, tmp_path / "run.bag")
    if said == NO_FILE:
        for look in (file_digests, list_recordings):
            with pytest.raises(DatasetError, match=said):
                look([tmp_path / "run.bag"])
    else:
        assert list_recordings([tmp_path / "run.bag"]) == [tmp_path / "run.bag"]
        assert file_digests([tmp_path / "run.bag"])[0]["bytes"] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_s_description_is_not_waited_for(tmp_path, kind):
    folder = bag_of_one_scan(tmp_path / "run")
    (folder / "metadata.yaml").unlink()
    if put(kind, folder / "metadata.yaml") == NO_FILE:
        with pytest.raises(DatasetError, match=NO_FILE):
            open_recording([folder])
    else:
        assert len(list(open_recording([folder]))) == 1


def test_of_two_databases_one_of_which_is_empty_the_other_is_read(tmp_path, caplog):
    folder = bag_of_one_scan(tmp_path / "run")
    (folder / "run_9.db3").touch()
    assert len(list(open_recording([folder]))) == 1
    assert "run_9.db3: is empty" in caplog.text


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_s_own_files_are_not_waited_for(tmp_path, kind):
    put(kind, tmp_path / NAME)
    assert changed_files(tmp_path) is None
    (tmp_path / NAME).unlink()
    (tmp_path / NAME).write_text("0  map.npz\n")
    put(kind, tmp_path / "map.npz")
    assert changed_files(tmp_path) == ["map.npz"]
    assert drive_lengths(tmp_path / "map.npz") == []
