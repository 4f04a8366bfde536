import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.evaluation.trajectory_errors import (
    ErrorStatistics,
    TrajectoryAlignmentError,
    align_trajectories,
    fit_rigid,
    relative_errors,
    remedy_of,
    systematic_error,
)
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import write_tum


def drive(seed, count=50):
    generator = np.random.default_rng(seed)
    poses = np.column_stack((generator.uniform(-5, 5, (count, 2)), generator.uniform(-3, 3, count)))
    return Trajectory(np.arange(count) * 0.1, poses)


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.1, 3.1), st.integers(0, 99))
def test_a_moved_copy_is_found(x, y, theta, seed):
    reference = drive(seed)
    T_reference_estimate = SE2(x, y, theta)
    result = align_trajectories(reference, reference.transformed(T_reference_estimate.inverse()))
    assert result.T_reference_estimate == pytest.approx(T_reference_estimate, abs=1e-6)
    assert result.ate_m < 1e-9


def test_ate_is_the_root_mean_square():
    reference = Trajectory(np.arange(4.0), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float))
    shifted = reference.poses.copy()
    shifted[[0, 3], 0] += 0.1
    shifted[[1, 2], 0] -= 0.1
    assert align_trajectories(reference, Trajectory(reference.stamps, shifted)).ate_m == pytest.approx(0.1, rel=1e-2)


def test_unrelated_clocks_are_refused():
    reference = drive(1)
    late = Trajectory(reference.stamps + 82.2, reference.poses)
    with pytest.raises(TrajectoryAlignmentError, match=r"only 0 of 50 poses have a partner within 0.01 s"):
        align_trajectories(reference, late)


motions = st.builds(SE2, st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi - 1e-9))


@settings(deadline=None)
@given(motion=motions, seed=st.integers(0, 1000), scale=st.floats(0.5, 2.0))
def test_the_fit_finds_the_motion_and_the_scale(motion, seed, scale):
    source = np.random.default_rng(seed).uniform(-5.0, 5.0, size=(7, 2))
    centred = source - source.mean(axis=0)
    found, found_scale = fit_rigid(motion.apply(scale * centred), centred)
    assert found_scale == pytest.approx(scale)
    np.testing.assert_allclose((motion.inverse() @ found).log(), 0.0, atol=1e-6)


def test_the_fit_never_mirrors():
    source = np.array([(0.0, 0.0), (2.0, 0.0), (0.0, 1.0)])
    found, _ = fit_rigid(source * (1.0, -1.0), source)
    assert np.linalg.det(found.matrix()[:2, :2]) == pytest.approx(1.0)


def test_coincident_points_have_no_scale():
    _, scale = fit_rigid(np.ones((3, 2)), np.zeros((3, 2)))
    assert math.isnan(scale)


def winding(count=300, rate=10.0):
    """Return a drive with turns, in both senses and past the half turn."""
    t = np.arange(count) / rate
    theta = 3.0 * np.sin(0.3 * t) + 0.1 * t
    steps = 0.07 * np.column_stack((np.cos(theta), np.sin(theta)))
    return Trajectory(1.3e9 + t, np.column_stack((np.cumsum(steps, axis=0), (theta + np.pi) % (2 * np.pi) - np.pi)))


def wrong(truth, seed):
    """Return a noisy, drifting copy in a frame of its own, which lacks some poses."""
    rng = np.random.default_rng(seed)
    poses = truth.poses + np.cumsum(rng.normal(0, [0.004, 0.004, 0.002], truth.poses.shape), axis=0)
    kept = np.sort(rng.choice(len(truth), len(truth) - 20, replace=False))
    stamps = truth.stamps[kept] + rng.uniform(-0.004, 0.004, len(kept))
    return Trajectory(stamps, poses[kept]).transformed(SE2(5.0, -3.0, 2.0))


def in_evo(truth, estimate, tmp_path):
    """Return both trajectories as evo reads and matches them."""
    pytest.importorskip("evo", reason="evo is not installed")
    from evo.core import sync
    from evo.tools import file_interface

    paths = tmp_path / "truth.tum", tmp_path / "estimate.tum"
    for path, trajectory in zip(paths, (truth, estimate), strict=True):
        write_tum(path, trajectory)
    return sync.associate_trajectories(*(file_interface.read_tum_trajectory_file(path) for path in paths))


def all_figures(metric):
    """Return evo's figures as ours are."""
    from evo.core.metrics import StatisticsType as Kind

    kinds = (Kind.rmse, Kind.mean, Kind.std, Kind.median, Kind.max)
    return ErrorStatistics(*(metric.get_statistic(kind) for kind in kinds))


def approximately(statistics):
    return pytest.approx(list(vars(statistics).values()), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_ate_is_evos(seed, tmp_path):
    truth = winding()
    estimate = wrong(truth, seed)
    reference, other = in_evo(truth, estimate, tmp_path)
    from evo.core import metrics

    other.align(reference, correct_scale=False)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, other))
    absolute = align_trajectories(truth, estimate)
    assert list(vars(ErrorStatistics.of(absolute.errors_m)).values()) == approximately(all_figures(ape))
    assert absolute.unmatched == len(estimate) - other.num_poses
    np.testing.assert_allclose(absolute.points, other.positions_xyz[:, :2], atol=1e-5)


@pytest.mark.parametrize("step", [0.3, 1.0, 4.0])
def test_rpe_over_a_distance_is_evos(step, tmp_path):
    truth = winding()
    estimate = wrong(truth, 7)
    pair = in_evo(truth, estimate, tmp_path)
    from evo.core import metrics

    relative = relative_errors(truth, estimate, distance=step)
    for relation, ours in (
        (metrics.PoseRelation.translation_part, relative.translations_m),
        (metrics.PoseRelation.rotation_angle_deg, relative.rotations_deg),
    ):
        rpe = metrics.RPE(relation, step, metrics.Unit.meters, pairs_from_reference=True)
        rpe.process_data(pair)
        np.testing.assert_allclose(ours, rpe.error, rtol=1e-4, atol=1e-5)
        assert list(vars(ErrorStatistics.of(ours)).values()) == approximately(all_figures(rpe))


def test_steps_of_time():
    truth = winding(100, rate=10.0)
    late = truth.poses.copy()
    late[50:, 0] += 0.2  # one jump: one step in ten sees it
    relative = relative_errors(truth, Trajectory(truth.stamps, late), seconds=0.95)
    assert len(relative.translations_m) == 9
    assert np.sort(relative.translations_m)[-2:] == pytest.approx([0.0, 0.2], abs=1e-9)


def test_a_perfect_estimate_in_another_frame_has_no_error():
    truth = winding()
    moved = truth.transformed(SE2(3.0, 4.0, -2.5))
    assert align_trajectories(truth, moved).errors_m.max() < 1e-9
    relative = relative_errors(truth, moved, distance=2.0)
    assert relative.translations_m.max() < 1e-9
    assert relative.rotations_deg.max() < 1e-9


@pytest.mark.parametrize("step", [1e-6, 1e-300])
def test_a_step_as_short_as_no_number_ends_at_each_pose(step):
    assert len(relative_errors(winding(), winding(), distance=step).translations_m) == len(winding()) - 1


def test_a_recorder_that_steps_back_passes_no_time_twice():
    stamps = np.array([0.0, 1.0, 0.5, 1.5, 2.5])
    drive = Trajectory(stamps, np.zeros((5, 3)))
    assert len(relative_errors(drive, drive, seconds=1.0).translations_m) == 3


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({}, "one of distance and seconds must be given, got None and None"),
        ({"distance": 1.0, "seconds": 1.0}, r"one of distance and seconds must be given, got 1\.0 and 1\.0"),
        ({"seconds": 0.0}, r"step must be positive, got 0\.0"),
    ],
)
def test_wrong_steps(step, message):
    with pytest.raises(ValueError, match=message):
        relative_errors(winding(), winding(), **step)


def test_a_drive_shorter_than_a_step():
    with pytest.raises(TrajectoryAlignmentError, match=r"300 common poses .* span 20.9 m, less than a step of 50 m"):
        relative_errors(winding(), winding(), distance=50.0)
    with pytest.raises(TrajectoryAlignmentError, match=r"the 0 common poses of the trajectories span 0 s"):
        relative_errors(winding(), Trajectory(np.zeros(1), np.zeros((1, 3))), seconds=1.0)


def test_figures_of_a_known_set():
    statistics = ErrorStatistics.of(np.array([0.0, 3.0, 4.0, 1.0]))
    assert statistics.rmse == pytest.approx(np.sqrt(26 / 4))
    assert statistics.mean == pytest.approx(2.0)
    assert statistics.standard_deviation == pytest.approx(np.sqrt(26 / 4 - 4))
    assert statistics.median == pytest.approx(2.0)
    assert statistics.maximum == pytest.approx(4.0)


def test_nothing_cannot_be_summed_up():
    with pytest.raises(ValueError, match="errors must hold at least one value, got none"):
        ErrorStatistics.of(np.zeros(0))


@pytest.fixture
def estimate(generator):
    """A winding drive of 60 s, which errs by 5 mm."""
    t = 0.05 * np.arange(1200)
    headings = 1.5 * np.sin(0.3 * t) + 0.1 * t
    points = np.cumsum(0.05 * 0.5 * np.column_stack((np.cos(headings), np.sin(headings))), axis=0)
    return Trajectory(100.0 + t, np.column_stack((points + generator.normal(0.0, 0.005, points.shape), headings)))


def true(estimate, lever=(0.0, 0.0, 0.0), seconds=0.0):
    poses = compose(np.array(SE2(3.0, -2.0, 0.7)), compose(estimate.poses, np.array(SE2(*lever))))
    return Trajectory(estimate.stamps + seconds, poses)


MOUNT = SE2(0.26, -0.05, 0.3)
AT_CENTRE = SE2(0.0, 0.0, 0.0)


def remedy(truth, estimate, frame, mount):
    error = systematic_error(truth, estimate, 0.01)
    assert error is not None
    return remedy_of(error, truth, estimate, 0.01, frame, mount)


def test_a_truth_of_the_laser_is_named(estimate):
    truth = true(estimate, MOUNT)
    error = systematic_error(truth, estimate, 0.01)
    assert error is not None
    assert error.fact.startswith("a point +0.26")
    assert "m ahead and -0.0" in error.fact
    assert remedy(truth, estimate, "robot", MOUNT) == "the truth may be of the laser: pass --frame laser"


def test_a_truth_of_the_robot_that_was_read_as_one_of_the_laser_is_named(estimate):
    truth = true(estimate, MOUNT.inverse())
    assert remedy(truth, estimate, "laser", MOUNT) == "the truth may be of the robot: pass --frame robot"


@pytest.mark.parametrize("frame", ["robot", "laser"])
def test_a_map_of_an_unknown_mount_is_of_the_laser(estimate, frame):
    said = remedy(true(estimate, MOUNT.inverse()), estimate, frame, AT_CENTRE)
    start, options = said.split(" with --sensor-pose ")
    assert start == (
        "the map was made with the laser at the robot's centre, so its trajectory is of the laser: if the truth is of "
        "the robot, map again"
    )
    x, y, degrees = map(float, options.split())
    assert (x, y) == pytest.approx(MOUNT[:2], abs=2e-3)
    assert degrees == pytest.approx(np.degrees(MOUNT.theta), abs=0.2)


def test_without_a_map_the_mount_is_suggested(estimate):
    start, options = remedy(true(estimate, MOUNT), estimate, "robot", None).split(" --sensor-pose ")
    assert start == "the truth may be of the laser: pass --frame laser"
    assert [float(value) for value in options.split()] == pytest.approx((0.26, -0.05, np.degrees(0.3)), abs=0.2)


def test_without_a_map_a_truth_of_other_headings_is_of_another_point(estimate):
    truth = true(estimate, MOUNT)
    truth.poses[:, 2] = 0.0
    assert remedy(truth, estimate, "robot", None).startswith("the truth may be of another point of the robot: correct")


@pytest.mark.parametrize("frame", ["robot", "laser"])
def test_no_option_is_suggested_that_would_not_help(estimate, frame):
    said = remedy(true(estimate, (0.2, 0.6, 0.0)), estimate, frame, MOUNT)
    assert "--frame" not in said
    assert "or the mount of the laser, 0.260 -0.050 17.2, is wrong: check both" in said


@pytest.mark.parametrize("seconds", [-2.0, 0.6, 3.0])
def test_a_clock_that_differs_is_named(estimate, seconds):
    truth = true(estimate, seconds=seconds)
    error = systematic_error(truth, estimate, 0.026)
    assert error is not None
    assert error.fact.startswith(
        f"stamps {abs(seconds):.2f} s {'later' if seconds > 0.0 else 'earlier'} fit the truth to 0.0"
    )
    said = remedy_of(error, truth, estimate, 0.026, "robot", MOUNT)
    assert said == "the clocks may differ: correct the stamps of one"


def test_a_truth_whose_stamps_step_back_tells_nothing_of_the_clocks(estimate):
    late = true(estimate, seconds=0.6)
    order = np.arange(1200)
    order[600:602] = 601, 600
    error = systematic_error(Trajectory(late.stamps[order], late.poses[order]), estimate, 0.026)
    assert error is not None
    assert error.T_estimate_truth is not None


def test_matches_at_other_times_are_no_offset_of_the_clocks(estimate):
    """The truth is alternately before and after the estimate: interpolation fits it, and no offset does."""
    poses, truth = np.arange(100, 1100, 20), true(estimate)
    others = poses + np.where(np.arange(len(poses)) % 2, 3, -3)
    matched = Trajectory(truth.stamps[others], truth.poses[others])
    assert systematic_error(matched, Trajectory(estimate.stamps[poses], estimate.poses[poses]), 0.16) is None


def test_a_good_estimate_needs_no_explanation(estimate):
    assert systematic_error(true(estimate), estimate, 0.01) is None


def test_nothing_constant_explains_an_estimate_that_drifts(estimate, generator):
    wrong = estimate.poses + np.cumsum(generator.normal(0.0, [0.01, 0.01, 0.002], estimate.poses.shape), axis=0)
    assert systematic_error(true(estimate), Trajectory(estimate.stamps, wrong), 0.01) is None


@pytest.mark.parametrize("count", [2, 3, 19])
def test_few_poses_explain_nothing(estimate, count):
    few = Trajectory(estimate.stamps[: 40 * count : 40], estimate.poses[: 40 * count : 40])
    assert systematic_error(true(estimate, (0.3, 0.0, 0.0)), few, 0.01) is None
