import math

import numpy as np
import pytest

from tbmslam.calibration.hand_eye import deviations_of_parts, motions_of, sensor_place, turn_lag
from tbmslam.geometry.se2 import SE2, compose

PLACE = SE2(0.3, -0.1, 0.4)
DEVIATION, STEPS = 0.005, 400


@pytest.fixture
def drive(generator):
    """Stamps, the robot's true poses and what it does at each: a winding way at changing speed, 5 poses a second."""
    turning = np.cumsum(generator.normal(0.0, 0.15, STEPS))
    rates, speeds = 0.6 * np.sin(turning), 0.3 + 0.3 * np.sin(np.arange(STEPS) / 9.0)
    poses = [SE2.identity()]
    for speed, rate in zip(speeds[:-1], rates[:-1], strict=True):
        poses.append(
            poses[-1] @ SE2(0.2 * speed * math.cos(0.1 * rate), 0.2 * speed * math.sin(0.1 * rate), 0.2 * rate)
        )
    return 0.2 * np.arange(STEPS), np.array(poses), speeds, rates


def seen_from(poses, generator, place=PLACE):
    """Return where a laser at a place sees itself, in a map that begins elsewhere."""
    sensors = compose(np.array([SE2(2.0, 1.0, -1.0)]), compose(poses, np.array([place])))
    return sensors + generator.normal(0.0, [DEVIATION, DEVIATION, 0.001], poses.shape)


def off(place, true=PLACE):
    return [
        abs(there - right) / deviation
        for there, right, deviation in zip(place.pose, true, place.deviations, strict=True)
    ]


def test_a_place_is_found_with_wheels_that_are_larger_than_thought(drive, generator):
    stamps, poses, _, _ = drive
    wheels = poses * [1.1, 1.1, 1.0]
    place = sensor_place(motions_of(stamps, wheels, seen_from(poses, generator)), 6, 8)
    assert place.pose == pytest.approx(PLACE, abs=0.03)
    assert max(off(place)) < 4.0
    assert max(place.deviations) < 0.02
    assert place.scale == pytest.approx(1.1, abs=0.01)


@pytest.mark.parametrize("wrong", ["jump", "frozen", "missing"])
def test_odometry_that_fails_for_a_while_hardly_matters(drive, generator, wrong):
    stamps, poses, _, _ = drive
    odometry = poses.copy()
    if wrong == "jump":
        odometry[200:] = compose(np.array([SE2(3.0, 1.0, 2.0)]), odometry[200:])
    elif wrong == "frozen":
        odometry[200:230] = odometry[200]
    else:
        odometry[100:200] = math.nan
    place = sensor_place(motions_of(stamps, odometry, seen_from(poses, generator)), 6, 8)
    assert place.pose == pytest.approx(PLACE, abs=0.04)
    assert max(off(place)) < 4.0


def test_a_clock_that_lags_is_no_wrong_place(drive, generator):
    stamps, poses, speeds, rates = drive
    ahead = np.column_stack((0.3 * speeds, np.zeros(STEPS), 0.3 * rates))
    place = sensor_place(motions_of(stamps, poses, seen_from(compose(poses, ahead), generator)), 6, 8)
    assert place.pose == pytest.approx(PLACE, abs=0.04)
    assert place.lag == pytest.approx(0.3, abs=0.04)
    assert abs(place.lag - 0.3) < 4.0 * place.lag_deviation < 0.12


def late_odometry(drive, generator, lag, beside=0.0):
    """Return stamps, odometry that is older by a lag, and the laser; poses by scans lie between true ones and late."""
    stamps, poses, _, _ = drive
    poses = np.column_stack((poses[:, :2], np.unwrap(poses[:, 2])))
    old = np.column_stack([np.interp(stamps - lag, stamps, column) for column in poses.T])
    placed = poses + beside * (old - poses) * [1.0, 1.0, 0.0]
    return stamps, old, seen_from(placed, generator)


@pytest.mark.parametrize("lag", [-0.6, -0.3, 0.0, 0.1, 0.3, 0.6])
def test_the_lag_is_found_from_rotations(drive, generator, lag):
    """Even if late odometry displaces the scans, or fails for a while, or if the mount is unknown."""
    stamps, odometry, sensors = late_odometry(drive, generator, lag, beside=0.5)
    odometry[100:110] = math.nan
    found = turn_lag(stamps, odometry, sensors, 6)
    assert found.seconds == pytest.approx(lag, abs=0.02)
    assert found.deviation < 0.03
    place = sensor_place(motions_of(stamps, odometry, sensors), 6, 8)
    assert abs(found.seconds - lag) <= abs(place.lag - lag) + 0.01


def test_clocks_that_stand_or_step_back_leave_the_first_estimate(drive, generator):
    stamps, odometry, sensors = late_odometry(drive, generator, 0.2)
    stamps = np.where(np.arange(STEPS) < 200, stamps, stamps - 30.0)
    assert turn_lag(stamps, odometry, sensors, 6).seconds == pytest.approx(0.2, abs=0.06)
    assert turn_lag(np.zeros(STEPS), odometry, sensors, 6).deviation > 0.12


def test_rotations_that_do_not_change_tell_no_lag(generator):
    poses = np.column_stack((0.1 * np.arange(STEPS), np.zeros(STEPS), np.zeros(STEPS)))
    assert turn_lag(0.2 * np.arange(STEPS), poses, seen_from(poses, generator), 6).deviation > 0.12
    assert turn_lag(np.arange(3.0), poses[:3], poses[:3], 6) is None
    assert turn_lag(np.arange(3.0), np.full((3, 3), math.nan), poses[:3], 6) is None


def test_where_the_robot_never_turns_the_place_is_open_but_not_its_turn(generator):
    poses = np.column_stack((0.1 * np.arange(STEPS), np.zeros(STEPS), np.zeros(STEPS)))
    place = sensor_place(motions_of(0.2 * np.arange(STEPS), poses, seen_from(poses, generator)), 6, 8)
    assert place.pose[2] == pytest.approx(0.4, abs=0.01)
    assert place.deviations[2] < 0.01
    assert min(place.deviations[:2]) > 0.1


def test_too_few_motions_tell_nothing(drive, generator):
    stamps, poses, _, _ = drive
    sensors = seen_from(poses, generator)
    assert sensor_place(motions_of(stamps, poses, sensors), 6, 40) is None
    assert sensor_place(motions_of(stamps, np.full((STEPS, 3), math.nan), sensors), 6, 8) is None
    assert sensor_place(motions_of(stamps[:2], poses[:2], sensors[:2]), 6, 8) is None
    assert sensor_place(motions_of(100.0 * stamps, poses, sensors), 6, 8) is None


def test_stamps_may_stand_still(drive, generator):
    _, poses, _, _ = drive
    place = sensor_place(motions_of(np.zeros(STEPS), poses, seen_from(poses, generator)), 6, 8)
    assert place.pose == pytest.approx(PLACE, abs=0.03)


PARTS, NUMBERS = 6, 3


def told(generator, claimed):
    """Return what parts tell with errors of 1, 2 and 3, each taking itself to know it so many times as well."""
    deviations = np.array([1.0, 2.0, 3.0])
    values = generator.normal(0.0, deviations, (PARTS, NUMBERS))
    informations = np.tile(np.diag((deviations / claimed) ** -2.0), (PARTS, 1, 1))
    return values, informations, values.mean(axis=0)


def test_parts_that_know_less_than_they_agree_are_believed(generator):
    found = deviations_of_parts(*told(generator, 0.1))
    np.testing.assert_allclose(found, np.array([10.0, 20.0, 30.0]) / np.sqrt(PARTS))


@pytest.mark.parametrize("claimed", [10.0, 1000.0])
def test_parts_that_differ_more_than_they_say_are_not(generator, claimed):
    """For parts that are all alike it is the standard error of their mean."""
    values, informations, mean = told(generator, claimed)
    expected = values.std(axis=0, ddof=1) / np.sqrt(PARTS)
    np.testing.assert_allclose(deviations_of_parts(values, informations, mean), expected)


def test_a_part_without_information_has_no_influence(generator):
    values, informations, mean = told(generator, 10.0)
    before = deviations_of_parts(values, informations, mean)
    values, informations = np.vstack((values, [[1e6] * 3])), np.concatenate((informations, 1e-12 * np.eye(3)[None]))
    after = deviations_of_parts(values, informations, mean)
    np.testing.assert_allclose(after, before * np.sqrt(7 / 6 * 5 / 6), rtol=1e-3)


def test_the_stated_deviation_equals_the_mean_error(generator):
    """Of numbers that each part knows along other directions, as walls tell poses."""
    off = []
    for _ in range(400):
        axes = generator.normal(size=(PARTS, NUMBERS, NUMBERS))
        informations = axes @ np.swapaxes(axes, 1, 2) + 0.1 * np.eye(NUMBERS)
        roots = np.linalg.cholesky(np.linalg.inv(informations))
        values = 2.0 * np.einsum("pij,pj->pi", roots, generator.normal(size=(PARTS, NUMBERS)))
        mean = np.linalg.solve(informations.sum(axis=0), np.einsum("pij,pj->i", informations, values))
        off.append(mean / deviations_of_parts(values, informations, mean))
    assert 0.85 < np.sqrt(np.mean(np.square(off))) < 1.4
