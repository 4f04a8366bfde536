"""The layers under a bag's border, each on bytes of its own: whole bags are too slow to be tried by the million."""

import struct
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin

from datasets.cleaning import KNOWN_CODES, RangeRules
from datasets.counts import ReadingCounts
from datasets.frames import FrameGraph, choose_frames
from datasets.mcap_salvage import salvage_mcap
from datasets.options import RecordingOptions
from datasets.ros1_salvage import salvage_ros1
from datasets.rosbag_messages import pose_of, scan_of, transforms_of
from datasets.salvaged_bag import SalvagedBag
from datasets.scan_intake import ScanIntake
from datasets.sqlite_salvage import salvage_sqlite
from datasets.synthetic.messages import Messages
from tbmslam.laser_scan import Reading
from tbmslam.se2 import SE2

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_ROS1, _ROS2 = Messages(ros1=True), Messages(ros1=False)
_DAMAGED = (OSError, ValueError, struct.error)  # what `BagSource` expects of a salvager and puts into words


def _drained(salvage: Callable[[Path, str], SalvagedBag]) -> Callable[[Path], None]:
    """Return what reads all that a salvager finds in a file, and asks what is lost."""

    def read(path: Path) -> None:
        with suppress(*_DAMAGED):
            bag = salvage(path, "damaged")
            for by_time in (False, True):
                sizes = [len(data) for _, _, data in bag.messages(bag.connections, by_time=by_time)]
            assert len(sizes) == sum(connection.msgcount for connection in bag.connections) == len(bag.entries)
            for connection in bag.connections:
                bag.times(connection.topic)
                assert all(loss.seconds >= 0.0 or loss.messages > 0 for loss in bag.losses(connection.topic))

    return read


def read_message(path: Path) -> None:
    """Decode bytes as each kind of message, and bring what comes out up to the SLAM."""
    content = path.read_bytes()
    for messages in (_ROS1, _ROS2):
        scan, transforms, odometry = (_decoded(messages, content, kind) for kind in (SCAN, messages.tf_type, ODOMETRY))
        if scan is not None:
            intake = ScanIntake(RangeRules(None, None, KNOWN_CODES, "free"), None, 2.0, ReadingCounts(), 0.1)
            taken = intake.take(scan_of(scan, 5.0))
            if taken is not None:
                Reading(taken, None).check()
                assert np.isfinite(taken.hit_points()).all()
        if transforms is not None:
            graph = FrameGraph()
            for item in transforms_of(transforms, 5.0):
                graph.add(item.parent, item.child, item.pose, False, 0.0)
                assert np.isfinite(item.pose).all()
            frames = choose_frames(graph, "laser", RecordingOptions())
            graph.doubts(frames.to_robot if frames else [])
        pose = pose_of(odometry, 5.0) if odometry is not None else None
        assert pose is None or np.isfinite(pose.pose).all()


def _decoded(messages: Messages, content: bytes, kind: str) -> Any:
    decode = messages.store.deserialize_ros1 if messages.ros1 else messages.store.deserialize_cdr
    try:
        return decode(content, kind)
    except Exception:  # noqa: BLE001 - as the reader of bags takes it: such a message is counted, and that is all
        return None


def message_seeds() -> list[bytes]:
    """Return a healthy message of each kind."""
    return [data for messages in (_ROS1, _ROS2) for _, _, data in _drive(messages, seconds=1)]


def ros1_seeds() -> list[bytes]:
    """Return small ROS 1 bags, plain and compressed."""
    seeds = []
    for compression in (None, "BZ2", "LZ4"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drive.bag"
            writer = rosbag1.Writer(path)
            if compression is not None:
                writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
            _write(writer, _ROS1)
            seeds.append(path.read_bytes())
    return seeds


def ros2_seeds(plugin: str) -> Callable[[], list[bytes]]:
    """Return what makes a small storage file of a ROS 2 bag."""

    def seeds() -> list[bytes]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "drive"
            _write(rosbag2.Writer(path, version=9, storage_plugin=StoragePlugin[plugin]), _ROS2)
            return [file.read_bytes() for file in path.iterdir() if file.suffix != ".yaml"]

    return seeds


def _write(writer: Any, messages: Messages) -> None:
    with writer:
        connections: dict[str, Any] = {}
        for second, kind, data in _drive(messages, seconds=3):
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


read_ros1, read_mcap, read_database = (_drained(each) for each in (salvage_ros1, salvage_mcap, salvage_sqlite))
