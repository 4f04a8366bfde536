"""The layers under a bag's border, each on bytes of its own: whole bags are too slow to be tried by the million."""

import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

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
from tests.fuzzing.seed_bags import ODOMETRY, ROS1, ROS2, SCAN

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
    for messages in (ROS1, ROS2):
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


read_ros1, read_mcap, read_database = (_drained(each) for each in (salvage_ros1, salvage_mcap, salvage_sqlite))
