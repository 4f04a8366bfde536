import numpy as np

from tbmslam import tracked_drive
from tbmslam.back_end import BackEnd
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracked_drive import TrackedDrive


def tracked(readings, corrected=None, **changes):
    config = changed(SlamConfig(), changes)
    drive = TrackedDrive(config, BackEnd(config), corrected)
    return drive, [drive.add(reading).T_map_robot for reading in readings]


def test_each_scan_is_corrected_before_it_is_used(drive_in):
    readings = drive_in("apartment", 10.0).readings
    turned = [reading.with_scan(reading.scan.backwards()) for reading in readings]
    drive, poses = tracked(turned, LaserScan.backwards)
    # Not equal to the bit: angles are counted from the other end.
    np.testing.assert_allclose(poses, tracked(readings)[1], atol=1e-6)
    np.testing.assert_array_equal(drive.poses(), poses)
    assert len(drive.keyframes(drive.poses())) == len(drive.buffer.keyframes) > 5


def test_without_loop_closing_no_keyframe_is_forgotten_and_none_is_packed(drive_in, monkeypatch):
    def fail(*_):
        raise AssertionError("packed all keyframes for one")

    monkeypatch.setattr(tracked_drive, "packed", fail)
    few = {"forgetting": {"limit": 100}, "keyframes": {"distance": 0.0}}
    drive, _ = tracked(drive_in("apartment", 30.0).readings, loop_closing={"enabled": False}, **few)
    assert len(drive.buffer.keyframes) > 120
