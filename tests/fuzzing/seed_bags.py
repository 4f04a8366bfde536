"""Healthy bags of three seconds without padding, so that nearly every byte that is changed in them means something."""

import re
import sqlite3
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin

from datasets.salvage.ros1 import record_at
from datasets.synthetic.bag_writing import Messages
from tbmslam.geometry.se2 import SE2

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
ROS1, ROS2 = Messages(ros1=True), Messages(ros1=False)


def message_seeds() -> list[bytes]:
    """Return a message of each kind."""
    return [data for messages in (ROS1, ROS2) for _, _, data in _drive(messages, seconds=1)]


def ros1_seeds() -> list[bytes]:
    """Return ROS 1 bags, plain and compressed."""
    seeds = []
    for compression in (None, "BZ2", "LZ4"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drive.bag"
            writer = rosbag1.Writer(path)
            if compression is not None:
                writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
            _write(writer, ROS1, without=ODOMETRY)  # each has 600 zeros
            seeds.append(_without_padding(path.read_bytes()))
    return seeds


def mcap_seeds() -> list[bytes]:
    """Return the storage file of a ROS 2 bag."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive"
        _write(rosbag2.Writer(path, version=9, storage_plugin=StoragePlugin.MCAP), ROS2, without=ODOMETRY)
        return [(path / "drive.mcap").read_bytes()]


def database_seeds() -> list[bytes]:
    """Return the database of a ROS 2 bag with the smallest pages, which a message of odometry does not fit into."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive"
        _write(rosbag2.Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3), ROS2)
        database = sqlite3.connect(path / "drive.db3")
        database.execute("PRAGMA page_size = 512")
        database.execute("VACUUM")
        database.close()
        return [(path / "drive.db3").read_bytes()]


def _without_padding(bag: bytes) -> bytes:
    """Return a ROS 1 bag without the 4000 spaces behind its header."""
    header = record_at(bag, bag.index(b"\n") + 1)
    assert header is not None
    padding = header.end - header.start
    content = bag[: header.start - 4] + bytes(4) + bag[header.end :]

    def moved(place: re.Match[bytes]) -> bytes:
        return place[1] + struct.pack("<Q", struct.unpack("<Q", place[2])[0] - padding)

    return re.sub(rb"((?:index|chunk)_pos=)(.{8})", moved, content, flags=re.DOTALL)


def _write(writer: Any, messages: Messages, without: str = "") -> None:
    with writer:
        connections: dict[str, Any] = {}
        for second, kind, data in _drive(messages, seconds=3):
            if kind == without:
                continue
            if kind not in connections:
                topic = {SCAN: "/scan", ODOMETRY: "/odom"}.get(kind, "/tf")
                # Real definitions would be most of the bytes.
                digest = {"md5sum": "*"} if messages.ros1 else {"rihs01": "RIHS01_" + "0" * 64}
                connections[kind] = writer.add_connection(topic, kind, msgdef="int8 x", **digest)
            writer.write(connections[kind], second * 10**9, data)


def _drive(messages: Messages, seconds: int) -> list[tuple[int, str, bytes]]:
    """Return second, kind and bytes of the messages of a short drive."""
    values = {"angle_min": -1.0, "angle_max": 1.0, "angle_increment": 0.5, "time_increment": 0.0, "scan_time": 0.1}
    values |= {"range_min": 0.1, "range_max": 30.0, "ranges": np.array([1.0, 2.0, np.inf, 3.0], dtype=np.float32)}
    made = []
    for second in range(1, seconds + 1):
        pose = SE2(0.1 * second, 0.0, 0.1)
        nanoseconds = second * 10**9
        made.append((second, messages.tf_type, messages.transform(nanoseconds, "odom", "base_link", pose)))
        made.append((second, ODOMETRY, messages.odometry(nanoseconds, "odom", "base_link", pose, (0.1, 0.0, 0.0))))
        made.append((second, SCAN, messages.scan(nanoseconds, "laser", values)))
    return made
