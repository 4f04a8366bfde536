from dataclasses import replace

import numpy as np
import pytest

from tbmslam.calibration.laser_check import LaserFitConfig, fit_laser
from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig
from tests.tbmslam.drifting_drive import drifting_keyframes

CONFIG = LaserFitConfig()


def fitted(robot, scale=0.0, offset=0.0, config=CONFIG, turn=0.0):
    """Return what is found where angles are stated larger by a share and ranges by an offset."""
    true, tracked, _ = drifting_keyframes(robot, turn, 0.4)
    laser = [robot.truth.pose(k) @ reading.T_robot_sensor for k, reading in enumerate(robot.readings)]
    kept = [int(np.argmin([np.hypot(p.x - x, p.y - y) + abs(p.theta - theta) for p in laser])) for x, y, theta in true]
    scans = [robot.readings[k].scan for k in kept]
    wrong = [replace(s, angle_increment=s.angle_increment * (1.0 + scale), ranges=s.ranges + offset) for s in scans]
    keyframes = Keyframes.from_scans(wrong, [SE2(*pose) for pose in tracked], [SE2.identity()] * len(tracked))
    return fit_laser(keyframes, ScanHits.of(keyframes, 40.0), tracked, config, AdjustmentConfig())


@pytest.mark.parametrize(("scale", "offset"), [(0.03, 0.0), (-0.01, 0.0), (0.0, 0.1), (0.0, -0.08), (0.01, 0.05)])
def test_a_laser_that_is_described_wrong_is_found_out(drive_in, scale, offset):
    errors = fitted(drive_in("office", 60.0, "good", seed=2), scale, offset)
    assert errors.scale == pytest.approx(1.0 / (1.0 + scale) - 1.0, abs=4.0 * errors.scale_deviation)
    assert errors.offset == pytest.approx(-offset, abs=4.0 * errors.offset_deviation)
    assert 0.0 < errors.scale_deviation < 0.0025
    assert 0.0 < errors.offset_deviation < 0.01


@pytest.mark.parametrize("world", ["office", "store", "apartment"])
def test_one_that_is_described_right_is_not(drive_in, world):
    errors = fitted(drive_in(world, 60.0, "good", seed=2))
    assert abs(errors.scale) < min(3.0 * errors.scale_deviation, 0.0035)
    assert abs(errors.offset) < min(3.0 * errors.offset_deviation, 0.02)


def test_a_drive_that_bends_is_no_wrong_laser(drive_in):
    errors = fitted(drive_in("office", 60.0, "good", seed=2), turn=0.003)
    assert abs(errors.scale) < 3.0 * errors.scale_deviation
    assert abs(errors.offset) < 3.0 * errors.offset_deviation


def test_one_that_turns_while_it_scans_is_no_wrong_laser(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)
    deviation = fitted(robot).scale_deviation
    # Beams of a laser that turns to the left all the time lie farther apart; here it turns to both sides.
    stamps = [reading.scan.stamp for reading in robot.readings]
    rates = np.gradient(np.unwrap([pose[2] for pose in robot.truth.poses]), stamps)
    readings = [
        replace(r, scan=replace(r.scan, angle_increment=r.scan.angle_increment * (1.0 + 0.02 * rate)))
        for r, rate in zip(robot.readings, rates, strict=True)
    ]
    assert abs(fitted(replace(robot, readings=tuple(readings))).scale) < 3.0 * deviation


def test_a_short_drive_gives_no_estimate(drive_in):
    assert fitted(drive_in("office", 15.0, "good", seed=2), 0.03) is None
    robot = drive_in("office", 60.0, "good", seed=2)
    assert fitted(robot, config=CONFIG.model_copy(update={"least_parts": 20, "most_parts": 20})) is None


def test_a_narrow_field_of_view_gives_no_estimate(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)
    readings = [
        replace(r, scan=replace(r.scan, angle_min=r.scan.angle_min + 1.0, ranges=r.scan.ranges[57:-57]))
        for r in robot.readings
    ]
    assert fitted(replace(robot, readings=tuple(readings)), 0.03) is None


def test_a_diverging_fit_gives_no_estimate(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)
    assert fitted(robot, 0.2) is None
    assert fitted(robot, 0.03, config=CONFIG.model_copy(update={"rounds": 1})) is None


def test_a_robot_at_rest_gives_no_estimate(drive_in):
    robot = drive_in("office", 15.0, "good", seed=2)
    scans = [robot.readings[0].scan] * 5
    keyframes = Keyframes.from_scans(scans, [SE2.identity()] * 5, [SE2.identity()] * 5)
    assert fit_laser(keyframes, ScanHits.of(keyframes, 40.0), np.zeros((5, 3)), CONFIG, AdjustmentConfig()) is None


def test_only_so_much_of_a_drive_is_looked_at(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)
    less, more = fitted(robot, config=CONFIG.model_copy(update={"longest": 4.0})), fitted(robot)
    assert less.scale_deviation > 1.2 * more.scale_deviation


def test_the_same_twice(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)
    assert fitted(robot, 0.01) == fitted(robot, 0.01)
