import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.faults import Fault, inject
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise, poses_at
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2, compose, inverse
from tbmslam.loop_closure import loose_steps
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.segmentation import in_frame
from tbmslam.slam import Slam
from tbmslam.tracking import odometry_fault, odometry_hypotheses, odometry_lag
from tbmslam.tracking.constant_velocity import ConstantVelocity


def mapped(readings, config=None):
    slam = Slam(config)
    for reading in readings:
        slam.process(reading)
    return slam.finish()


def ate(robot, tbm_map):
    return align_trajectories(robot.truth, tbm_map.drives[0].trajectory).ate_m


def test_the_default_preset_follows_poor_odometry(drive_in):
    robot = drive_in("apartment", 30.0)
    tbm_map = mapped(robot.readings)
    assert ate(robot, tbm_map) < 0.03
    drive = tbm_map.drives[0]
    assert len(drive.trajectory) == len(robot.readings)
    assert 10 < len(drive.keyframes) < len(robot.readings)
    assert abs(tbm_map.grid.masses.sum(axis=-1) - 1.0).max() < 1e-5
    assert tbm_map.grid.masses[..., 0].max() > 0.0


def test_the_map_holds_the_closures_and_the_distance_that_they_moved_the_drive(drive_in):
    slam = Slam()
    for reading in drive_in("apartment", 90.0).readings:
        slam.process(reading)
    drive = slam.finish().drives[0]
    assert len(drive.closures) >= 2
    earlier, later = drive.keyframes.stamps[drive.closures].T
    assert (later - earlier > 5.0).all()
    poses = drive.keyframes.poses[drive.closures]
    assert np.hypot(*(poses[:, 0] - poses[:, 1])[:, :2].T).max() < 6.0
    assert 0.0 < slam.correction_m < 0.5
    assert drive.motions is not None
    assert len(drive.motions) == len(drive.keyframes) - 1
    lasers = drive.keyframes.all_sensor_poses()
    steps = compose(inverse(lasers[:-1]), lasers[1:])
    assert (
        0.0 < np.hypot(*(steps - drive.motions.steps)[:, :2].T).max() < 0.05
    )  # loops bend a drive, a little everywhere
    assert drive.closure_motions is not None
    first, second = lasers[drive.closures[:, 0]], lasers[drive.closures[:, 1]]
    seen = compose(inverse(first), second) - drive.closure_motions.steps
    assert 0.0 < np.hypot(*seen[:, :2].T).max() < 0.1


def test_keyframes_tell_which_poses_of_the_drive_they_are_where_stamps_step_back(drive_in):
    robot = drive_in("apartment", 30.0)
    back = 0.2 * np.array([0, 1, 5, 150])[np.arange(len(robot.readings)) * 4 // len(robot.readings)]
    readings = [
        replace(one, scan=replace(one.scan, stamp=one.scan.stamp - late))
        for one, late in zip(robot.readings, back.tolist(), strict=True)
    ]
    drive = mapped(readings).drives[0]
    assert (np.diff(drive.trajectory.stamps) < 0.0).sum() >= 2
    indices = drive.keyframes.indices
    np.testing.assert_array_equal(drive.trajectory.stamps[indices], drive.keyframes.stamps)
    np.testing.assert_array_equal(drive.trajectory.poses[indices], drive.keyframes.poses)


def test_odometry_may_count_from_far_away(drive_in):
    """As in a grid of the whole earth, where single precision tells half a metre apart."""
    readings, shift = drive_in("apartment", 30.0).readings, SE2(512_000.0, 4_600_000.0, 0.0)
    there, here = mapped([in_frame(one, shift) for one in readings]), mapped(readings)
    moved = there.drives[0].trajectory.poses - [*shift]
    np.testing.assert_allclose(moved, here.drives[0].trajectory.poses, atol=1e-3)
    assert there.grid.geometry.origin_x == pytest.approx(here.grid.geometry.origin_x + shift.x, abs=0.06)
    assert (there.grid.is_known().sum() - here.grid.is_known().sum()) / here.grid.is_known().sum() < 0.001


def test_it_needs_no_odometry(drive_in):
    robot = drive_in("apartment", 30.0)
    assert ate(robot, mapped([replace(r, T_odom_robot=None) for r in robot.readings])) < 0.1


@pytest.mark.parametrize(
    ("name", "resolution"), [("viny", 0.1), ("viny-hc", 0.1), ("tiny", 0.1), ("credibilist", 0.05)]
)
def test_the_original_and_its_relatives_map_too(drive_in, name, resolution):
    robot = drive_in("apartment", 30.0, odometry="good")
    tbm_map = mapped(robot.readings, preset(name))
    assert ate(robot, tbm_map) < 0.15
    assert tbm_map.grid.masses[..., 0].max() == 0.0
    assert tbm_map.grid.geometry.resolution == resolution


def test_means_know_no_ignorance(drive_in):
    masses = mapped(drive_in("apartment", 15.0).readings, preset("tiny")).grid.masses
    known = masses[..., 3] < 1.0
    assert known.any()
    assert masses[known][:, 3].max() < 1e-8


def test_same_readings_same_map(drive_in):
    robot = drive_in("apartment", 15.0)
    first, second = mapped(robot.readings), mapped(robot.readings)
    assert first.grid.geometry == second.grid.geometry
    np.testing.assert_array_equal(first.grid.masses, second.grid.masses)
    np.testing.assert_array_equal(first.drives[0].trajectory.poses, second.drives[0].trajectory.poses)


def test_the_laser_may_sit_anywhere(drive_in):
    """The same hits, told by a laser mounted elsewhere, give the same drive of the robot."""
    robot = drive_in("apartment", 15.0)
    mount = SE2(-0.3, 0.2, 2.0)
    T_mount_sensor = mount.inverse() @ robot.readings[0].T_robot_sensor
    turned = [
        Reading(
            replace(r.scan, angle_min=r.scan.angle_min + T_mount_sensor.theta),
            r.T_odom_robot,
            SE2(r.T_robot_sensor.x, r.T_robot_sensor.y, mount.theta),
        )
        for r in robot.readings
    ]
    straight, other = mapped(robot.readings), mapped(turned)
    difference = straight.drives[0].trajectory.poses - other.drives[0].trajectory.poses
    assert np.abs(difference[:, :2]).max() < 0.01


def test_odometry_that_freezes_in_a_turn_is_survived(drive_in):
    robot = drive_in("apartment", 30.0, odometry="good")
    headings = np.unwrap([r.T_odom_robot.theta for r in robot.readings])
    turning = int(np.argmax(np.abs(headings[8:] - headings[:-8])))
    frozen = [
        replace(r, T_odom_robot=robot.readings[turning].T_odom_robot) if turning < k < turning + 8 else r
        for k, r in enumerate(robot.readings)
    ]
    assert ate(robot, mapped(frozen)) < 0.05


def test_loops_are_closed(drive_in):
    robot = drive_in("office", 120.0, odometry="poor", seed=1)
    left_open = mapped(robot.readings, changed(SlamConfig(), {"loop_closing": {"enabled": False}}))
    closed = mapped(robot.readings)
    assert len(left_open.drives[0].closures) == 0
    assert len(closed.drives[0].closures) > 8
    assert ate(robot, closed) < 0.6 * ate(robot, left_open)


def test_empty_and_blind_scans_pass_through():
    readings = [
        Reading(LaserScan(float(k), -1.0, 0.1, 0.1, 10.0, ranges), SE2(0.1 * k, 0.0, 0.0))
        for k, ranges in enumerate([np.full(5, np.nan), np.zeros(0), np.full(7, np.inf), np.full(5, 2.0)])
    ]
    tbm_map = mapped(readings)
    assert len(tbm_map.drives[0].trajectory) == 4
    assert tbm_map.grid.is_known().any()


def test_no_readings_make_an_empty_map_without_a_correction():
    slam = Slam()
    slam.correction_m = 0.3  # that of an earlier map
    tbm_map = slam.finish()
    assert slam.correction_m == 0.0
    assert len(tbm_map.drives[0].trajectory) == 0
    assert not tbm_map.grid.is_known().any()


def test_a_turn_between_two_slow_scans_is_that_of_the_odometry():
    """In a crossing the turn that was not taken fits as well, and a second after it the robot may go anywhere."""
    angle_min, angle_increment = SimulatedLaser.field_of(180)
    laser = SimulatedLaser(beams=180, angle_min=angle_min, angle_increment=angle_increment, rate=1.0)
    drive = EndlessDrive("round", 140.0, laser, OdometryNoise.preset("good"))
    slam = Slam()
    for reading in drive.readings():
        slam.process(reading)
    errors = align_trajectories(drive.truth(), slam.finish().drives[0].trajectory).errors_m
    assert errors.max() < 0.1


def test_a_wrong_angle_step_causes_a_warning(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)

    def told(wrong, config=None):
        slam = Slam(config)
        for reading in robot.readings:
            slam.process(replace(reading, scan=wrong(reading.scan)))
        for _ in range(2):  # and once only
            slam.finish()
        return [incident.what for incident in slam.incidents]

    def wide(scan):
        return replace(scan, angle_increment=1.03 * scan.angle_increment)

    (angles,) = told(wide)
    assert angles.startswith("walls fit best where beams are ")
    assert angles.endswith(" degrees apart, not 1.03: try --angle-step-deg 1")
    (ranges,) = told(lambda scan: replace(scan, ranges=scan.ranges + 0.1))
    assert ranges == "walls fit best where ranges are 0.10 m shorter than measured: try --range-offset -0.10"
    assert told(lambda scan: scan) == []
    assert told(wide, changed(SlamConfig(), {"laser_fit": {"enabled": False}})) == []


def test_a_wrong_mount_causes_a_warning(drive_in):
    robot = drive_in("office", 60.0, "good", seed=2)

    def told(config=None, **wrong):
        slam = Slam(config)
        for reading in robot.readings:
            slam.process(replace(reading, **wrong))
        slam.finish()
        return [incident.what for incident in slam.incidents if "laser" in incident.what]

    elsewhere = SE2(0.1, 0.25, math.radians(-12.0))
    (place,) = told(T_robot_sensor=elsewhere)
    assert place.startswith("odometry and scans fit best where the laser sits on the robot at 0.2")
    assert ", 0 degrees, not at 0.10, 0.25 m, -12 degrees: try --sensor-pose 0.2" in place
    assert told(T_robot_sensor=elsewhere, T_odom_robot=None) == []
    assert told(changed(SlamConfig(), {"mount_check": {"enabled": False}}), T_robot_sensor=elsewhere) == []
    # Too wide angles turn all of the view, and are told alone, as mending them may mend the place, too.
    scans = [replace(r.scan, angle_increment=1.03 * r.scan.angle_increment) for r in robot.readings]
    robot = replace(robot, readings=[replace(r, scan=scan) for r, scan in zip(robot.readings, scans, strict=True)])
    assert told(T_robot_sensor=elsewhere) == []


def test_an_upside_down_laser_causes_a_warning(drive_in):
    robot = drive_in("office", 40.0, "good", seed=2)
    slam = Slam()
    for reading in robot.readings:
        scan = reading.scan
        mirrored = replace(scan, angle_min=-scan.angle_min, angle_increment=-scan.angle_increment)
        slam.process(replace(reading, scan=mirrored))
    slam.finish()
    told = [incident.what for incident in slam.incidents if incident.all_along]
    assert len(told) == 1
    assert told[0].startswith("the scans turn left where the odometry turns right: the laser hangs upside down, and")


def test_a_scan_that_is_no_keyframe_costs_what_docs_scaling_says(drive_in):
    reading, slam = drive_in("apartment", 5.0, "good").readings[0], Slam()

    def stand(first, last):
        for k in range(first, last):
            slam.process(replace(reading, scan=replace(reading.scan, stamp=0.1 * k)))

    stand(0, 1000)
    tracemalloc.start()
    stand(1000, 4000)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Arrays that grow are moved as a whole, and take an eighth more than they need.
    assert grown < 1.2 * 32 * 4000


def test_walls_correct_a_drive_with_few_closures(drive_in):
    robot = drive_in("open_plan", 90.0, seed=1, beams=361)
    readings = [replace(r, T_odom_robot=None) for r in robot.readings]
    before = ate(robot, mapped(readings, changed(SlamConfig(), {"adjustment": {"enabled": False}})))
    after = ate(robot, mapped(readings))
    assert after < 0.8 * before
    assert after < 0.005


@pytest.mark.parametrize("seed", [9, 27])
def test_a_crowd_in_a_corridor_that_hides_all_but_its_walls_does_not_hold_the_robot_back(drive_in, seed):
    """Nor a crowd that is close around from the start (27)."""
    alone = drive_in("corridor", 30.0, odometry="good", seed=seed)
    robot = inject(alone, Fault("crowd", 0.0, math.inf), make_world("corridor", seed))
    assert ate(robot, mapped(robot.readings)) < 0.03


def test_a_laser_of_a_single_beam_needs_no_step():
    rng, slam = np.random.default_rng(0), Slam()
    for k in range(30):
        scan = LaserScan(float(k), 0.0, 0.0, 0.02, 30.0, 0.5 + rng.normal(0.0, 0.003, 1))
        slam.process(Reading(scan, SE2(0.3 * k, 0.0, 0.0)))
    assert len(slam.finish().drives[0].trajectory) == 30


def _with_reversed_odometry(alone, world):
    """Return a drive whose odometry tells the opposite for six seconds, and its readings."""
    robot = inject(alone, Fault("odometry_reversed", 20.0, 6.0), world)
    odometry = poses_at(robot.odometry, robot.truth.stamps).tolist()
    return robot, [replace(r, T_odom_robot=SE2(*p)) for r, p in zip(robot.readings, odometry, strict=True)]


def test_odometry_that_is_reversed_for_six_seconds_is_overruled(drive_in):
    alone = drive_in("office", 40.0, odometry="good", seed=2)
    robot, readings = _with_reversed_odometry(alone, make_world("office", 2))
    told, right = (np.array([r.T_odom_robot for r in each]) for each in (readings, alone.readings))
    assert np.hypot(*(told - right)[:, :2].T).max() > 2.0
    assert ate(robot, mapped(readings)) < 0.006


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_laser_that_sees_a_metre_needs_to_know_how_good_the_odometry_is(drive_in, seed):
    """Learnt from the few scans that determine anything."""
    robot = drive_in("apartment", 60.0, odometry="good", seed=seed)
    readings = [
        replace(r, scan=replace(r.scan, range_max=1.0, ranges=np.where(r.scan.ranges < 1.0, r.scan.ranges, np.inf)))
        for r in robot.readings
    ]
    learning = ate(robot, mapped(readings))
    stated = ate(robot, mapped(readings, changed(SlamConfig(), {"motion": {"odometry": {"learning": False}}})))
    assert learning < 0.4 * stated
    assert learning < 0.08


def _errors_of_a_narrow_view(drive_in, late: int) -> list[float]:
    """Return the ATE [m] of drives with 30 degrees of view, where the odometry comes some scans of 0.2 s late."""
    errors = []
    for seed in range(4):
        robot = drive_in("apartment", 60.0, odometry="good", seed=seed)
        sees = np.abs(np.arange(len(robot.readings[0].scan.ranges)) - 90) < 15
        readings = [
            replace(r, scan=replace(r.scan, ranges=np.where(sees, r.scan.ranges, np.inf))) for r in robot.readings
        ]
        odometry = [r.T_odom_robot for r in readings]
        pairs = zip(readings[late:], odometry, strict=False)
        errors.append(ate(robot, mapped([replace(r, T_odom_robot=pose) for r, pose in pairs])))
    return errors


def test_odometry_that_comes_late_is_moved_to_the_time_of_the_scans(drive_in):
    assert max(_errors_of_a_narrow_view(drive_in, 1)) < 0.12


@pytest.mark.slow
def test_odometry_that_comes_late_needs_the_estimate_of_its_lag(drive_in, monkeypatch):
    """Ablation of `tbmslam.tracking.odometry_lag`, which changes nothing where odometry comes in time."""
    in_time, late = (np.mean(_errors_of_a_narrow_view(drive_in, number)) for number in (0, 1))
    monkeypatch.setattr(odometry_lag, "_USUAL", 1e-9)
    assert in_time < 1.1 * np.mean(_errors_of_a_narrow_view(drive_in, 0)) < 0.04
    assert late < 0.3 * np.mean(_errors_of_a_narrow_view(drive_in, 1))


def _ate_with_a_gap(drive_in) -> float:
    """Return the ATE [m] in an office with poor odometry, where twelve seconds of scans are missing."""
    robot = drive_in("office", 120.0, odometry="poor", seed=0)
    middle = 0.5 * (robot.readings[0].scan.stamp + robot.readings[-1].scan.stamp)
    return ate(robot, mapped([r for r in robot.readings if not middle <= r.scan.stamp < middle + 12.0]))


def test_a_gap_in_the_scans_is_bridged_by_a_loop(drive_in):
    assert _ate_with_a_gap(drive_in) < 0.015


@pytest.mark.slow
def test_a_gap_in_the_scans_needs_wide_searches(drive_in, monkeypatch):
    """Ablation of `tbmslam.loop_closure.loose_steps`."""
    monkeypatch.setattr(loose_steps, "_LOOSE_M", math.inf)
    monkeypatch.setattr(loose_steps, "_LOOSE_RAD", math.inf)
    assert _ate_with_a_gap(drive_in) > 0.1


def _ate_with_reversed_odometry(drive_in, seed: int) -> float:
    """Return the ATE [m] along a corridor where the odometry tells the opposite for six seconds."""
    alone = drive_in("corridor", 40.0, odometry="good", seed=seed)
    robot, readings = _with_reversed_odometry(alone, make_world("corridor", seed))
    return ate(robot, mapped(readings))


def test_odometry_that_is_reversed_along_a_corridor_is_overruled(drive_in):
    assert _ate_with_reversed_odometry(drive_in, 1) < 0.015


@pytest.mark.slow
@pytest.mark.parametrize("ablation", ["keyframes judged alone", "no inertia"])
def test_reversed_odometry_along_a_corridor_needs_the_fault_model_and_inertia(drive_in, monkeypatch, ablation):
    """Ablation of `tbmslam.tracking.odometry_fault` and of the prior by the robot's last motion."""
    seeds = range(5)
    assert max(_ate_with_reversed_odometry(drive_in, seed) for seed in seeds) < 0.1
    if ablation == "no inertia":
        monkeypatch.setattr(ConstantVelocity, "coasting", lambda *_: None)
    else:
        monkeypatch.setattr(odometry_fault, "_BEGINS", 0.0)
        monkeypatch.setattr(odometry_hypotheses, "_SWERVE", math.inf)
    assert np.median([_ate_with_reversed_odometry(drive_in, seed) for seed in seeds]) > 1.0


def test_a_scan_a_second_is_enough():
    """Some laps round a block, where consecutive scans are half a metre apart."""
    angle_min, angle_increment = SimulatedLaser.field_of(180)
    laser = SimulatedLaser(beams=180, angle_min=angle_min, angle_increment=angle_increment, rate=1.0)
    drive = EndlessDrive("round", 500.0, laser, OdometryNoise.preset("good"))
    assert align_trajectories(drive.truth(), mapped(drive.readings()).drives[0].trajectory).ate_m < 0.01
