import math

import numpy as np
import pytest

from datasets import open_recording
from datasets.synthetic.bag_writing import write_ros1_bag
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.faults import FAULTS, Fault, inject
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from datasets.synthetic.robot.surroundings import ranges_of
from tbmslam.geometry.se2 import compose, inverse
from tools.make_world import FAULTS as OFFERED

# One worker simulates the drives for all of them.
pytestmark = pytest.mark.xdist_group("faults of sensors")


@pytest.fixture(scope="module")
def world():
    return make_world("apartment", 4)


@pytest.fixture(scope="module")
def robot(world):
    angle_min, step = SimulatedLaser.field_of(181)
    laser = SimulatedLaser(beams=181, angle_min=angle_min, angle_increment=step, rate=5.0)
    return simulate(world, plan_drives(world, 1, duration=20.0, seed=4), laser, OdometryNoise.preset("none"), 4)[0]


def with_fault(robot, world, name, at=5.0, seconds=6.0):
    return inject(robot, Fault(name, at, seconds), world, 1)


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_leaves_a_recording_that_can_be_read(robot, world, tmp_path, name):
    faulty = with_fault(robot, world, name)
    write_ros1_bag(faulty, tmp_path / "run.bag")
    readings = list(open_recording([tmp_path / "run.bag"]))
    assert 0.6 * len(robot.readings) < len(readings) <= len(robot.readings)
    again = with_fault(robot, world, name)
    assert [r.scan.stamp for r in faulty.readings] == [r.scan.stamp for r in again.readings]
    assert len(faulty.truth) == len(faulty.readings)
    for one, other in zip(faulty.readings, again.readings, strict=True):
        np.testing.assert_array_equal(one.scan.ranges, other.scan.ranges)


def test_the_program_offers_all_of_them():
    assert tuple(FAULTS) == OFFERED


@pytest.mark.parametrize("later", ["laser_gap", "clock_offset", "stamps_twice", "carried", "people"])
def test_a_fault_after_stamps_stepped_back_leaves_scans_recorded_in_their_order(robot, world, later):
    """The recorder's clock goes on rising, whatever the stamps; a gap takes its times out of it, too."""
    faulty = with_fault(with_fault(robot, world, "stamps_back"), world, later)
    assert len(faulty.recorded) == len(faulty.readings)
    assert (np.diff(faulty.recorded) > 0.0).all()


def test_a_fault_after_the_clock_was_wrong_is_at_its_time_by_the_recorder(robot, world):
    wrong_clock = with_fault(robot, world, "clock_offset", at=0.0)
    alone, after = (with_fault(each, world, "odometry_gap") for each in (robot, wrong_clock))
    np.testing.assert_array_equal(after.odometry.stamps, alone.odometry.stamps)
    for name in ("beams_blocked", "people", "furniture", "carried", "lift"):
        alone, after = (with_fault(each, world, name) for each in (robot, wrong_clock))
        np.testing.assert_array_equal(ranges_of(after), ranges_of(alone))
        np.testing.assert_array_equal(after.truth.poses, alone.truth.poses)
        np.testing.assert_allclose(after.recorded, alone.recorded, atol=1e-6)


def steps(trajectory):
    return np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T)


def test_odometry_faults(robot, world):
    assert np.diff(with_fault(robot, world, "odometry_gap").odometry.stamps).max() == pytest.approx(6.0, abs=0.1)
    assert steps(with_fault(robot, world, "odometry_jump").odometry).max() == pytest.approx(math.hypot(2, 1), abs=0.1)
    reset = with_fault(robot, world, "odometry_reset").odometry
    assert reset.poses[np.searchsorted(reset.stamps, robot.truth.stamps[0] + 5.0)] == pytest.approx(0.0, abs=0.05)
    frozen = with_fault(robot, world, "odometry_freeze").odometry
    stuck = with_fault(robot, world, "odometry_stuck").odometry
    assert steps(stuck).max() <= steps(robot.odometry).max() + 1e-9
    held = (frozen.stamps >= frozen.stamps[0] + 5.1) & (frozen.stamps < frozen.stamps[0] + 10.9)
    for odometry in (frozen, stuck):
        assert np.ptp(odometry.poses[held], axis=0).max() == 0.0
    assert not np.allclose(stuck.poses[-1], frozen.poses[-1])


def test_reversed_odometry_reports_the_opposite_translation(robot, world):
    faulty = inject(robot, Fault("odometry_reversed", 5.0, 6.0, 2.5), world, 1).odometry
    stamps, first = robot.odometry.stamps, robot.truth.stamps[0]
    motions, reported = (compose(inverse(o.poses[:-1]), o.poses[1:]) for o in (robot.odometry, faulty))
    wrong = (stamps[1:] >= first + 5.0) & (stamps[1:] < first + 11.0)
    np.testing.assert_allclose(reported[wrong], motions[wrong] * (-2.5, -2.5, 1.0), atol=1e-9)
    np.testing.assert_allclose(reported[~wrong], motions[~wrong], atol=1e-9)
    assert np.hypot(*motions[wrong, :2].T).sum() > 1.0  # it drove meanwhile
    np.testing.assert_allclose(faulty.poses[:, 2], robot.odometry.poses[:, 2], atol=1e-9)


@pytest.mark.parametrize("at", [0.0, 15.0])
def test_odometry_may_be_reversed_to_either_end_of_a_drive(robot, world, at):
    faulty = inject(robot, Fault("odometry_reversed", at, 60.0), world, 1).odometry
    assert steps(faulty) == pytest.approx(steps(robot.odometry), abs=1e-9)
    assert not np.allclose(faulty.poses[-1], robot.odometry.poses[-1])


def test_odometry_in_another_unit(robot, world):
    faulty = with_fault(robot, world, "odometry_unit").odometry
    np.testing.assert_allclose(faulty.poses / (100.0, 100.0, 1.0), robot.odometry.poses)


def test_clock_faults(robot, world):
    assert np.diff(with_fault(robot, world, "stamps_back").truth.stamps).min() == pytest.approx(-0.1, abs=1e-5)
    twice = with_fault(robot, world, "stamps_twice").truth.stamps
    assert (np.diff(twice) == 0.0).sum() == 15
    late = with_fault(robot, world, "clock_offset")
    assert late.recorded - late.truth.stamps == pytest.approx(np.full(len(late.truth), 82.2), abs=1e-5)
    stepped = np.array([reading.scan.stamp for reading in with_fault(robot, world, "clock_step").readings])
    assert np.unique(np.round(robot.truth.stamps - stepped, 3)).tolist() == [0.0, 3.0]


def test_scan_faults(robot, world):
    gap = with_fault(robot, world, "laser_gap")
    assert np.diff(gap.truth.stamps).max() == pytest.approx(6.2, abs=0.01)
    for name, at, share in (("beams_blocked", 30, 0.45), ("glass", 30, 0.0), ("people", 40, 0.0)):
        faulty = with_fault(robot, world, name)
        changed = [
            np.mean(one.scan.ranges != other.scan.ranges)
            for one, other in zip(robot.readings, faulty.readings, strict=True)
        ]
        assert max(changed[:25]) == 0.0 == max(changed[56:])
        assert max(changed[25:55]) > share
        assert changed[at] >= share
    before, after = (
        np.array([r.scan.ranges for r in with_fault(robot, world, "furniture", at=at).readings]) for at in (0.0, 100.0)
    )
    assert (before != after).any()


@pytest.mark.parametrize("name", ["laser_gap", "carried"])
def test_a_fault_without_a_scan_left_is_refused(robot, world, name):
    with pytest.raises(ValueError, match="a fault must leave at least one scan: shorten it"):
        with_fault(robot, world, name, 0.0, 9999.0)


def test_a_laser_described_wrong(robot, world):
    for name in ("range_offset", "angle_step"):
        changed = with_fault(robot, world, name).readings
        for k, (one, other) in enumerate(zip(robot.readings, changed, strict=True)):
            is_wrong, hit = 25 <= k < 55, one.scan.is_hit()
            longer = 0.1 if is_wrong and name == "range_offset" else 0.0
            np.testing.assert_allclose(other.scan.ranges[hit], one.scan.ranges[hit] + longer, atol=1e-5)
            wider = 1.03 if is_wrong and name == "angle_step" else 1.0
            assert other.scan.angle_increment == pytest.approx(wider * one.scan.angle_increment, rel=1e-9)


def test_a_laser_stated_elsewhere_measures_from_its_true_place(robot, world, tmp_path):
    moved = with_fault(robot, world, "mount")
    assert moved.laser == robot.laser  # the truth
    (stated,) = {reading.T_robot_sensor for reading in moved.readings}
    assert tuple(robot.laser.T_robot_sensor.to(stated)) == pytest.approx((0.0, 0.3, math.radians(10.0)))
    write_ros1_bag(moved, tmp_path / "run.bag")
    assert next(iter(open_recording([tmp_path / "run.bag"]))).T_robot_sensor == pytest.approx(stated)
    for later in ("glass", "parts_in_view"):
        after, alone = (with_fault(each, world, later) for each in (moved, robot))
        np.testing.assert_array_equal(ranges_of(after), ranges_of(alone))


def test_a_carried_robot_loses_the_way_between(robot, world):
    carried = with_fault(robot, world, "carried")
    jump = int(np.argmax(np.diff(carried.truth.stamps)))
    assert np.diff(carried.truth.stamps)[jump] == pytest.approx(2.2, abs=0.01)
    assert steps(carried.truth)[jump] > 1.0
    assert steps(carried.odometry).max() < 0.1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("people", r"a fault must look like laser_gap@30, laser_gap@30\+60 or"),
        ("laser_gap@1.2.3", r"a fault must look like laser_gap@30, .*, got 'laser_gap@1\.2\.3'"),
        ("laser_gap@.", r"a fault must look like laser_gap@30, .*, got 'laser_gap@\.'"),
        ("fire@3", "a fault must be one of odometry_gap, .*, got 'fire'"),
        ("people@3+0", "seconds be positive, got 3.0, 0.0"),
        ("odometry_reversed@3+4x0", "scale must be positive, got 0.0"),
        ("people@3+4x2", "only odometry_reversed has a scale, got 2.0 for people"),
    ],
)
def test_faults_that_cannot_be_meant(text, message):
    with pytest.raises(ValueError, match=message):
        Fault.parse(text)
    assert Fault.parse("people@3+2.5") == Fault("people", 3.0, 2.5)
    assert Fault.parse("odometry_reversed@3+4x2.7") == Fault("odometry_reversed", 3.0, 4.0, 2.7)
