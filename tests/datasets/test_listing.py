import os

import pytest

from datasets.errors import DatasetError
from datasets.listing import list_recordings


def test_a_directory_stands_for_the_recordings_in_it(tmp_path):
    for name in ("b.bag", "a.log.gz", "c.CLF", "notes.txt", "world.npz", "b.truth.tum", ".hidden.bag"):
        (tmp_path / name).touch()
    (tmp_path / "ros2").mkdir()
    (tmp_path / "ros2" / "metadata.yaml").touch()
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "bare_0.mcap").touch()
    (tmp_path / "pictures").mkdir()
    found = list_recordings([tmp_path / "elsewhere.bag", tmp_path])
    assert [path.name for path in found] == ["elsewhere.bag", "a.log.gz", "b.bag", "bare", "c.CLF", "ros2"]


def test_a_ros_2_bag_stays_one(tmp_path):
    (tmp_path / "metadata.yaml").touch()
    (tmp_path / "x.db3").touch()
    assert list_recordings([tmp_path]) == [tmp_path]


def test_a_directory_without_any(tmp_path):
    with pytest.raises(DatasetError, match=r"a directory without recordings \(.*\): give the one that they lie in"):
        list_recordings([tmp_path])


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"run\.bag: is no file but a device or a pipe: give a recording's file"):
        list_recordings([tmp_path / "run.bag"])
    with pytest.raises(DatasetError, match="a directory without recordings"):
        list_recordings([tmp_path])
