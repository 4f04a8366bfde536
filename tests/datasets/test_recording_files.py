import hashlib
import os

import pytest

from datasets.errors import DatasetError
from datasets.recording_files import file_digests, list_recordings


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
    with pytest.raises(DatasetError, match=r"a directory without recordings \(.*\): give another directory"):
        list_recordings([tmp_path])


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "run.bag")
    with pytest.raises(DatasetError, match=r"run\.bag: is a device or a pipe: give a recording's file"):
        list_recordings([tmp_path / "run.bag"])
    with pytest.raises(DatasetError, match="a directory without recordings"):
        list_recordings([tmp_path])


def test_files_are_told_by_their_content(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "b.db3").write_bytes(b"data")
    (tmp_path / "bag" / "a.yaml").write_bytes(b"")
    digests = file_digests([tmp_path / "bag"])
    assert digests[1] == {"name": "b.db3", "bytes": 4, "sha256": hashlib.sha256(b"data").hexdigest()}
    assert [one["name"] for one in digests] == ["a.yaml", "b.db3"]


def test_a_missing_file(tmp_path):
    with pytest.raises(DatasetError, match=r"x\.bag: no such file or directory"):
        file_digests([tmp_path / "x.bag"])
