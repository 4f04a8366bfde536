import gzip
from pathlib import Path

import pytest

from datasets import DatasetError, open_recording


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
        ("picture.png", b"\x89PNG\0\0", r"picture\.png: neither a ROS bag nor a CARMEN log"),
    ],
)
def test_files_of_no_use(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DatasetError, match=message):
        open_recording([tmp_path / name])


def test_paths_of_no_use(tmp_path):
    with pytest.raises(DatasetError, match=r"nope\.bag: no such file or directory"):
        open_recording([tmp_path / "nope.bag"])
    with pytest.raises(DatasetError, match=r"a directory without a ROS 2 bag"):
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
