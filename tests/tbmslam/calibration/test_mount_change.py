"""A laser that is turned on its robot during the drive."""

import math

import numpy as np
import pytest

from tbmslam.calibration.hand_eye import motions_of
from tbmslam.calibration.mount_check import mount_changes
from tbmslam.geometry.se2 import SE2, compose

STEPS, LEAST = 400, math.radians(5.0)
MOUNT = SE2(0.3, 0.1, 0.2)


@pytest.fixture
def drive(generator):
    """Stamps and true poses of a winding way, and the odometry's poses, whose steps err by a twentieth."""
    true, wheels = [SE2.identity()], [SE2(3.0, 1.0, 0.5)]
    for k in range(STEPS - 1):
        step = np.array([0.12, 0.0, 0.15 * math.sin(k / 5.0)])
        true.append(true[-1] @ SE2(*step))
        wheels.append(wheels[-1] @ SE2(*(step + generator.normal(0.0, [0.006, 0.006, 0.005]))))
    return 0.3 * np.arange(STEPS), np.array(true), np.array(wheels)


def seen(true, generator, turns=()):
    """Return where a laser sees itself that is turned at keyframes by angles [rad]."""
    mounts = np.tile(np.array(MOUNT), (len(true), 1))
    for keyframe, turn in turns:
        mounts[keyframe:, 2] += turn
    return compose(true, mounts) + generator.normal(0.0, [0.005, 0.005, 0.002], true.shape)


@pytest.mark.parametrize("turn", [-0.7, -0.15, 0.12, 0.35])
def test_a_knock_is_found_at_its_keyframe(drive, generator, turn):
    stamps, true, wheels = drive
    (change,) = changes(stamps, wheels, seen(true, generator, [(170, turn)]), LEAST)
    assert abs(change.keyframe - 170) <= 1
    assert change.turn == pytest.approx(turn, abs=0.02)


def changes(stamps, odometry, sensors, least):
    return mount_changes(motions_of(stamps, odometry, sensors), odometry, sensors, least)


def test_two_knocks_are_found_in_order(drive, generator):
    stamps, true, wheels = drive
    found = changes(stamps, wheels, seen(true, generator, [(130, 0.3), (290, -0.2)]), LEAST)
    assert [change.turn for change in found] == pytest.approx([0.3, -0.2], abs=0.03)
    assert [change.keyframe for change in found] == pytest.approx([130, 290], abs=1)


def test_a_fixed_laser_has_no_change_at_any_mount(drive, generator):
    stamps, true, wheels = drive
    assert changes(stamps, wheels, seen(true, generator), LEAST) == []
    assert changes(stamps, wheels, seen(true, generator, [(0, 0.5)]), LEAST) == []
    assert changes(stamps, wheels, seen(true, generator, [(200, 0.03)]), LEAST) == []


def test_faulty_odometry_is_no_knock(drive, generator):
    stamps, true, wheels = drive
    sensors = seen(true, generator)
    reversed_since = wheels.copy()
    for k in range(200, STEPS):  # it tells backward what goes forward, from here on
        step = SE2(*wheels[k - 1]).to(SE2(*wheels[k]))
        reversed_since[k] = SE2(*reversed_since[k - 1]) @ SE2(-step.x, -step.y, step.theta)
    turned = wheels.copy()
    turned[200:] = compose(np.array(SE2(1.0, 0.0, 0.6))[None], wheels[200:])  # a jump as of a robot that is carried
    missing = np.full_like(wheels, math.nan)
    for odometry in (reversed_since, turned, missing):
        assert changes(stamps, odometry, sensors, LEAST) == []


def test_a_short_drive_gives_no_estimate(drive, generator):
    stamps, true, wheels = drive
    sensors = seen(true, generator, [(20, 0.5)])
    assert changes(stamps[:40], wheels[:40], sensors[:40], LEAST) == []
    assert changes(stamps[:1], wheels[:1], sensors[:1], LEAST) == []
