import numpy as np
import pytest

from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise
from tbmslam.geometry.se2 import SE2, compose, inverse
from tbmslam.loop_closure import loop_closer
from tbmslam.loop_closure.closure_graph import ClosureGraphConfig
from tbmslam.loop_closure.far_search import PlaceIndex
from tbmslam.loop_closure.loop_closer import LoopCloser, LoopClosingConfig
from tbmslam.loop_closure.sequence_consistency import ClosureVotes, ClosureVotesConfig
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, edge_errors, relative_pose
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam
from tbmslam.tracking.surfel_map import SurfelConfig
from tests.tbmslam.drifting_drive import drifting_keyframes, errors, packed

INFORMATION = np.diag([0.004**-2, 0.004**-2, 0.002**-2])


def drifting(robot, drift_per_metre):
    """Return true and drifting laser poses of a keyframe every 0.4 m, their scans and the motions between them."""
    true, tracked, scans = drifting_keyframes(robot, drift_per_metre, 0.4)
    chain = [MotionEdge(k, k + 1, relative_pose(tracked, k, k + 1), INFORMATION) for k in range(len(tracked) - 1)]
    return true, tracked, scans, MotionChain.of(chain)


@pytest.mark.parametrize(("world", "left"), [("apartment", 0.5), ("office", 0.1), ("store", 0.25)])
def test_a_drifting_drive_is_bent_back(drive_in, world, left):
    true, tracked, scans, chain = drifting(drive_in(world, None, seed=1), 0.001)
    closed, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert len(closures) > 5
    assert errors(true, closed).max() < left * errors(true, tracked).max()
    for edge in closures:
        error = relative_pose(true, edge.source, edge.target).inverse() @ edge.T_source_target
        covariance = np.linalg.inv(edge.information)
        assert np.array(error[:2]) @ np.linalg.inv(covariance[:2, :2]) @ np.array(error[:2]) < 6.0**2


def test_a_self_similar_corridor_closes_nothing_false(drive_in):
    true, tracked, scans, chain = drifting(drive_in("corridor", 80.0, seed=1), 0.0)
    closed, _ = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert errors(true, closed).max() < 0.1


def test_a_drive_that_never_comes_back_stays_as_it_is():
    poses = np.column_stack((np.arange(0.0, 30.0, 0.5), np.zeros(60), np.zeros(60)))
    scans = [LaserScan(float(k), -1.5, 0.05, 0.1, 20.0, np.full(60, 2.0 + 0.01 * k)) for k in range(60)]
    chain = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), INFORMATION) for k in range(59)]
    closed, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(
        poses, packed(scans), MotionChain.of(chain)
    )
    assert closures == []
    np.testing.assert_array_equal(closed, poses)


def test_closures_that_the_rest_contradicts_are_dropped(drive_in):
    true, tracked, scans, chain = drifting(drive_in("office", None, seed=1), 0.001)
    kept, strict = (
        LoopCloser(LoopClosingConfig(graph=ClosureGraphConfig(max_contradiction=most)), SurfelConfig()).close(
            tracked, scans, chain
        )
        for most in (1e9, 0.25)
    )
    assert 15 < len(strict[1]) < len(kept[1])
    assert edge_errors(strict[1], strict[0]).max() < 0.3
    assert edge_errors(kept[1], kept[0]).max() > 0.35
    assert errors(true, strict[0]).max() < 1.5 * errors(true, kept[0]).max()


def test_a_keyframe_is_registered_to_one_of_the_near_submaps(drive_in, monkeypatch):
    fit, verified = loop_closer._Drive._fit, []

    def noted(drive, keyframe, *how):
        found = fit(drive, keyframe, *how)
        verified.extend([keyframe] if found is not None else [])
        return found

    monkeypatch.setattr(loop_closer._Drive, "_fit", noted)
    monkeypatch.setattr(loop_closer._Drive, "tighten", lambda _: None)
    _, tracked, scans, chain = drifting(drive_in("office", None, seed=1), 0.0)
    LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert len(verified) > 10
    assert len(set(verified)) == len(verified)


def test_few_submaps_are_kept_at_a_time(drive_in, monkeypatch):
    """Forgotten ones are built again and give the same poses."""
    robot = drive_in("apartment", 60.0)
    slam = Slam()
    for reading in robot.readings:
        slam.process(reading)
    expected = slam.finish().drives[0]
    monkeypatch.setattr("tbmslam.loop_closure.candidates._SUBMAPS_KEPT", 1)
    found = slam.finish().drives[0]
    assert len(expected.closures) > 0
    np.testing.assert_array_equal(found.closures, expected.closures)
    np.testing.assert_array_equal(found.trajectory.poses, expected.trajectory.poses)


def drifting_far(robot, seed, deviations=(0.02, 0.005, 0.02)):
    """Return true and tracked laser poses, scans, and motions with the stated standard deviations."""
    true, _, scans = drifting_keyframes(robot, 0.0, 0.4)
    generator, deviations = np.random.default_rng(seed), np.array(deviations)
    tracked, chain = [SE2.from_array(true[0])], []
    for k in range(len(true) - 1):
        step = relative_pose(true, k, k + 1) @ SE2(*generator.normal(0.0, deviations))
        tracked.append(tracked[-1] @ step)
        chain.append(MotionEdge(k, k + 1, step, np.diag(deviations**-2.0)))
    return true, np.array(tracked), scans, MotionChain.of(chain)


def false_closures(true, closures):
    errors = [relative_pose(true, edge.source, edge.target).inverse() @ edge.T_source_target for edge in closures]
    return [error for error in errors if np.hypot(error.x, error.y) > 0.5]


def test_a_drive_that_drifted_beyond_every_window_closes(drive_in):
    true, tracked, scans, chain = drifting_far(drive_in("halls", 250.0, "good", seed=1), 1)
    assert errors(true, tracked).max() > 30.0
    closed, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert errors(true, closed)[-1] < 0.5
    assert len(closures) > 10
    assert false_closures(true, closures) == []


@pytest.mark.slow
def test_a_drive_that_drifted_beyond_every_window_stays_open_without_signatures(drive_in, monkeypatch):
    """Ablation of `tbmslam.loop_closure.far_search`: 23 m instead of 0.3 m."""
    true, tracked, scans, chain = drifting_far(drive_in("halls", 250.0, "good", seed=1), 1)
    monkeypatch.setattr(PlaceIndex, "likeliest", lambda *_: np.zeros(0, dtype=np.int64))
    closed, _ = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert errors(true, closed)[-1] > 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("world", "length", "seed"), [("corridor", 120, 3), ("hospital", 250, 2), ("office", 150, 2)])
def test_a_find_of_one_keyframe_is_false_where_others_need_not_agree(drive_in, world, length, seed):
    """Ablation of `tbmslam.loop_closure.sequence_consistency`."""
    true, *drive = drifting_far(drive_in(world, length, "good", seed), seed, (0.15, 0.02, 0.003))
    alone = LoopClosingConfig(votes=ClosureVotesConfig(stops=1, margin=1.0))
    for config, expected in ((LoopClosingConfig(), False), (alone, True)):
        _, closures = LoopCloser(config, SurfelConfig()).close(*drive)
        assert (len(false_closures(true, closures)) > 0) is expected


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "rivals_vote"), [(0, True), (0, False), (1, True), (1, False)])
def test_lanes_of_equal_crossings_are_told_apart_by_their_rivals(monkeypatch, seed, rivals_vote):
    """Ablation of `ClosureVotes.rivals`: many closures join lanes 100 m apart that were driven once each."""
    angle_min, step = SimulatedLaser.field_of(180)
    laser = SimulatedLaser(beams=180, angle_min=angle_min, angle_increment=step, rate=1.3)
    drive = EndlessDrive("spiral", 2500.0, laser, OdometryNoise.preset("good"), seed)
    readings = list(drive.readings())
    poses = np.array([truth @ reading.T_robot_sensor for truth, reading in zip(poses_of(drive), readings, strict=True)])
    steps = compose(inverse(poses[:-1]), poses[1:])
    chain = MotionChain(steps, np.tile(np.diag(np.array([0.01, 0.005, 0.004]) ** -2.0), (len(steps), 1, 1)))
    if not rivals_vote:
        monkeypatch.setattr(ClosureVotes, "rivals", lambda *_: [])
    scans = packed([reading.scan for reading in readings])
    _, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(poses, scans, chain)
    assert (len(false_closures(poses, closures)) > 50) is not rivals_vote
    assert not rivals_vote or closures == []


def poses_of(drive):
    return [SE2.from_array(pose) for pose in drive.truth().poses]


def test_a_far_drift_closes_nothing_false_where_all_is_alike(drive_in):
    true, tracked, scans, chain = drifting_far(drive_in("corridor", 80.0, "good", seed=1), 1)
    assert errors(true, tracked).max() > 20.0
    _, closures = LoopCloser(LoopClosingConfig(), SurfelConfig()).close(tracked, scans, chain)
    assert false_closures(true, closures) == []


def test_the_parameters_as_they_stand_may_be_stated():
    assert LoopClosingConfig(**LoopClosingConfig().model_dump()) == LoopClosingConfig()
