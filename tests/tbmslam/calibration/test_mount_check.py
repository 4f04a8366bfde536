import math
from dataclasses import replace

import numpy as np
import pytest

from tbmslam.calibration.hand_eye import Motions, motions_of, sensor_place
from tbmslam.calibration.mount_check import MountCheckConfig, mount_warning
from tbmslam.geometry.se2 import SE2, compose, inverse
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan

CONFIG = MountCheckConfig()
TRUE = SE2(0.25, 0.0, 0.0)
STEPS = 300


def winding(turning=0.5, steps=STEPS):
    poses = [SE2.identity()]
    for k in range(steps - 1):
        poses.append(poses[-1] @ SE2(0.12, 0.0, 0.3 * turning * math.sin(k / 5.0)))
    return np.array(poses)


def doubt(stated, generator, odometry=None, turning=0.5, steps=STEPS):
    """Return what is said where the laser is stated to sit somewhere, and the odometry is what it is."""
    true = winding(turning, steps)
    sensors = compose(true, np.array([TRUE])) + generator.normal(0.0, [0.003, 0.003, 0.001], true.shape)
    scan = LaserScan(0.0, -1.0, 0.1, 0.1, 30.0, np.ones(20))
    scans = [replace(scan, stamp=0.3 * k) for k in range(steps)]
    poses = compose(sensors, inverse(np.array([stated])))
    keyframes = Keyframes.from_scans(scans, [SE2(*pose) for pose in poses], [stated] * steps)
    motions = motions_of(keyframes.stamps, true if odometry is None else odometry, keyframes.all_sensor_poses())
    return mount_warning(keyframes, motions, sensor_place(motions, CONFIG.parts, CONFIG.motions), CONFIG)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (SE2(0.25, 0.3, 0.0), "0.25, 0.30 m, 0 degrees"),
        (SE2(-0.1, 0.0, 0.0), "-0.10, 0.00 m, 0 degrees"),
        (SE2(0.25, 0.0, math.radians(8.0)), "0.25, 0.00 m, 8 degrees"),
        (SE2(0.25, 0.0, math.pi), "0.25, 0.00 m, 180 degrees"),
    ],
)
def test_a_laser_that_sits_elsewhere(generator, stated, words):
    said = doubt(stated, generator)
    assert said is not None
    assert f"not at {words}: try --sensor-pose 0.2" in said
    assert said.startswith("odometry and scans fit best where the laser sits on the robot at 0.2")
    x, y, turn = map(float, said.split("--sensor-pose ")[1].split())
    assert (x, y, turn) == pytest.approx((0.25, 0.0, 0.0), abs=0.02)
    assert "-0.00" not in said


@pytest.mark.parametrize(("metres", "is_told"), [(14.0, True), (7.0, False)])
def test_a_short_drive_tells_a_laser_that_looks_back(generator, metres, is_told):
    said = doubt(SE2(0.25, 0.0, math.pi), generator, steps=round(metres / 0.12))
    assert (said is not None and "not at 0.25, 0.00 m, 180 degrees" in said) is is_told


@pytest.mark.parametrize(("turned", "is_told"), [(180.0, True), (12.0, False), (0.0, False)])
def test_poor_odometry_tells_a_laser_that_looks_back(generator, turned, is_told):
    """Its angle is known to 10 degrees only."""
    true = winding(steps=150)
    odometry = true + generator.normal(0.0, [0.1, 0.1, 0.0], true.shape)
    said = doubt(SE2(0.25, 0.0, math.radians(turned)), generator, odometry, steps=150)
    assert (said is not None) is is_told
    if said is not None:
        assert float(said.split()[-1]) == pytest.approx(0.0, abs=10.0)


@pytest.mark.parametrize("stated", [TRUE, SE2(0.35, 0.0, 0.0), SE2(0.25, -0.1, math.radians(4.0))])
def test_one_that_sits_where_it_should_or_nearly(generator, stated):
    assert doubt(stated, generator) is None


def test_a_robot_without_rotation_determines_only_the_angle(generator):
    assert doubt(SE2(0.25, 5.0, 0.0), generator, turning=0.0) is None
    said = doubt(SE2(0.1, 0.2, math.radians(20.0)), generator, turning=0.0)
    assert said is not None
    assert said.endswith("try --sensor-pose 0.10 0.20 0")


def test_there_is_no_warning_without_odometry_or_with_other_odometry(generator):
    wrong = SE2(0.25, 0.3, 0.0)
    assert doubt(wrong, generator, np.full((STEPS, 3), math.nan)) is None
    assert doubt(wrong, generator, np.zeros((STEPS, 3))) is None
    assert doubt(wrong, generator, winding() * [1.5, 1.5, 1.0]) is None
    assert doubt(wrong, generator, np.cumsum(generator.normal(0.0, 0.1, (STEPS, 3)), axis=0)) is None


def mirrored(generator, turning=0.5, steps=STEPS):
    """Return poses as scans tell them that are mirrored, as those of a laser upside down are where nobody knows."""
    flipped = winding(turning, steps) * [1.0, -1.0, -1.0]
    return flipped + generator.normal(0.0, [0.01, 0.01, 0.02], flipped.shape)


@pytest.mark.parametrize("steps", [STEPS, 25], ids=["36 m", "3 m"])
def test_a_laser_that_hangs_upside_down_unsaid(generator, steps):
    said = doubt(TRUE, generator, mirrored(generator, steps=steps), steps=steps)
    assert said == (
        "the scans turn left where the odometry turns right: the laser hangs upside down, and the map is a mirror "
        "image (--upside-down; --no-upside-down where tf says so), or the odometry is wrong (--odometry none)"
    )


def test_turns_that_tell_nothing_of_upside_down(generator):
    straight = doubt(TRUE, generator, mirrored(generator, 0.0), turning=0.0)
    unlike = doubt(TRUE, generator, np.cumsum(generator.normal(0.0, 0.1, (STEPS, 3)), axis=0))
    absent = doubt(TRUE, generator, np.full((STEPS, 3), math.nan))
    assert straight is unlike is absent is None


@pytest.mark.parametrize(
    ("count", "size", "noise", "is_told"),
    [
        (20, 0.2, 0.02, True),
        (20, 0.04, 0.004, False),  # a total rotation of 0.8 rad
        (3, 0.5, 0.15, False),  # evidence of 7
        (2000, 0.2, 0.4, False),  # evidence of 500, but hardly correlated
    ],
)
def test_what_mirrored_rotations_need(count, size, noise, is_told):
    wheels = size * np.resize([1.0, -1.0], count)
    seen = noise * np.resize([1.0, 1.0, -1.0, -1.0], count) - wheels
    assert is_upside_down(wheels, seen) is is_told


def test_a_turn_on_the_spot_by_half_a_turn_is_not_mirrored():
    wheels, seen = np.full(6, 0.1), np.full(6, 0.1)
    wheels[0], seen[0] = math.pi - 0.01, 0.01 - math.pi
    assert not is_upside_down(wheels, seen)


def is_upside_down(wheels, seen):
    """Return whether rotations of a drive [rad] cause the warning."""
    count, scan = len(wheels), LaserScan(0.0, -1.0, 0.1, 0.1, 30.0, np.ones(20))
    keyframes = Keyframes.from_scans([scan], [TRUE], [TRUE])
    turns = np.column_stack((wheels, seen))
    motions = Motions(np.zeros((2, count), int), np.zeros((count, 2, 5)), np.zeros((count, 2)), turns)
    said = mount_warning(keyframes, motions, None, CONFIG)
    assert said is None or said.startswith("the scans turn left where the odometry turns right")
    return said is not None
