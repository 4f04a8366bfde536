"""The layers under a bag's border, each on bytes of its own: whole bags are too slow to be tried by the million."""

import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from datasets.counts import ReadingCounts
from datasets.odometry.frames import FrameGraph, choose_frames
from datasets.options import RecordingOptions
from datasets.rosbag.messages import ODOMETRY_TYPE, SCAN_TYPE, TF_TYPES, FramedScan, MessageDecoder
from datasets.salvage.mcap_file import salvage_mcap
from datasets.salvage.ros1 import salvage_ros1
from datasets.salvage.salvaged_bag import SalvagedBag
from datasets.salvage.sqlite_file import salvage_sqlite
from datasets.scans.cleaning import KNOWN_CODES, RangeRules
from datasets.scans.intake import ScanIntake
from tbmslam.sensing.laser_scan import Reading

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
    for is_ros1 in (True, False):
        decoded = MessageDecoder(is_ros1).decoded
        scan, transforms, odometry = (decoded(kind, content) for kind in (SCAN_TYPE, TF_TYPES[0], ODOMETRY_TYPE))
        if isinstance(scan, FramedScan):
            intake = ScanIntake(RangeRules(None, None, KNOWN_CODES, "free"), None, 2.0, ReadingCounts(), 0.1)
            taken = intake.take(scan.stamped(5.0))
            if taken is not None:
                Reading(taken, None).check()
                assert np.isfinite(taken.hit_points()).all()
        if isinstance(transforms, list):
            graph = FrameGraph()
            for item in transforms:
                graph.add(item.parent, item.child, item.pose, False, 0.0)
                assert np.isfinite(item.pose).all()
            frames = choose_frames(graph, "laser", RecordingOptions())
            graph.doubts(frames.to_robot if frames else [])
        assert all(np.isfinite(item.pose).all() for item in odometry or ())


read_ros1, read_mcap, read_database = (_drained(each) for each in (salvage_ros1, salvage_mcap, salvage_sqlite))
