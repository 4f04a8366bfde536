import gzip
import hashlib
import os
from pathlib import Path

import pytest

from datasets import DatasetError, open_recording
from datasets.opening import file_digests, list_recordings


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.bag", b"", r"empty\.bag: is empty: give a recording's file or folder"),
        ("odd.bag", b"hello", r"odd\.bag: does not begin like a \.bag file"),
        ("odd.mcap", b"hello", r"odd\.mcap: does not begin like a \.mcap file"),
        (
            "run.bag.gz",
            gzip.compress(b"#ROSBAG V2.0\n", mtime=0),
            r"run\.bag\.gz: the bag is damaged \(ReaderError: Header could not be read from file\.\); no message in it",
        ),
        ("cut.log.gz", gzip.compress(b"FLASER " * 99, mtime=0)[:20], r"cut\.log\.gz: cannot be read to its end"),
        ("a.MCAP", b"\x89MCAP0\r\n", r"a\.MCAP: is a \.mcap file of another name: rename it to end in \.mcap$"),
        ("a.mcap", b"SQLite format 3\0", r"a\.mcap: is a \.db3 file of another name: rename it to end in \.db3$"),
        (
            "a.gz",
            gzip.compress(b"SQLite format 3\0", mtime=0),
            r"a\.gz: is a \.db3 file .*: rename it to end in \.db3\.gz$",
        ),
        (
            "metadata.yaml",
            b"rosbag2_bagfile_information:\n  version: 9\n",
            r"/metadata\.yaml: describes a ROS 2 bag: give its folder, \S+[^/]$",
        ),
        ("picture.png", b"\x89PNG\0\0", r"picture\.png: is neither a ROS bag nor a CARMEN log: give a laser recording"),
    ],
)
def test_files_of_no_use(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DatasetError, match=message):
        open_recording([tmp_path / name])


def test_paths_of_no_use(tmp_path):
    with pytest.raises(DatasetError, match=r"nope\.bag: no such file or directory"):
        open_recording([tmp_path / "nope.bag"])
    with pytest.raises(DatasetError, match=r"a directory without a ROS 2 bag .*: give a recording's file or folder"):
        open_recording([tmp_path])
    (tmp_path / "a.bag").touch()
    with pytest.raises(DatasetError, match=r"a directory of ROS 1 bags; give the files themselves: a\.bag"):
        open_recording([tmp_path])
    with pytest.raises(DatasetError, match=r"/dev/zero: is a device or a pipe"):
        open_recording([Path("/dev/zero")])
    with pytest.raises(ValueError, match="paths must name at least one file, got none"):
        open_recording([])


def test_bags_and_logs_do_not_mix(script, tmp_path):
    bag = script.scan(100.0).write(tmp_path / "run.bag")
    log = tmp_path / "run.log"
    log.write_text("FLASER 0\n")
    with pytest.raises(DatasetError, match=r"run\.bag \(rosbag\), .*run\.log \(carmen\): bags and logs cannot be one"):
        open_recording([bag, log])


def test_a_directory_is_replaced_by_its_recordings(tmp_path):
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


def test_files_are_identified_by_their_content(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "b.db3").write_bytes(b"data")
    (tmp_path / "bag" / "a.yaml").write_bytes(b"")
    digests = file_digests([tmp_path / "bag"])
    assert digests[1] == {"name": "b.db3", "bytes": 4, "sha256": hashlib.sha256(b"data").hexdigest()}
    assert [one["name"] for one in digests] == ["a.yaml", "b.db3"]


def test_a_missing_file(tmp_path):
    with pytest.raises(DatasetError, match=r"x\.bag: no such file or directory: check the path"):
        file_digests([tmp_path / "x.bag"])
