import numpy as np

from tbmslam.back_end import BackEnd
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.tracked_drive import TrackedDrive


def tracked(readings, **options):
    config = SlamConfig()
    drive = TrackedDrive(config, BackEnd(config), **options)
    return drive, [drive.add(reading).T_map_robot for reading in readings]


def test_a_backwards_drive_is_one_of_scans_that_were_turned_around(drive_in):
    readings = drive_in("apartment", 10.0).readings
    turned = [reading.with_scan(reading.scan.backwards()) for reading in readings]
    drive, poses = tracked(turned, is_backwards=True)
    # Not equal to the bit: angles are counted from the other end.
    np.testing.assert_allclose(poses, tracked(readings)[1], atol=1e-6)
    np.testing.assert_array_equal(drive.poses(), poses)
    assert len(drive.keyframes(drive.poses())) == len(drive.buffer.keyframes) > 5
