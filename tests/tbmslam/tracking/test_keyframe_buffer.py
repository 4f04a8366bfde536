from itertools import pairwise

import numpy as np
import pytest

from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise
from tbmslam.configuration.slam_config import preset
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.optimisation.pose_graph import MotionEdge, relative_pose
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam
from tbmslam.tracking.forgetting import ForgettingConfig
from tbmslam.tracking.keyframe_buffer import KeyframeBuffer
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, chain, motions, packed
from tbmslam.tracking.tracker import ScanMatch

SCAN = LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.ones(3))
T_ROBOT_SENSOR = SE2(0.2, 0.1, 0.3)
ROUND = 80


@pytest.fixture
def rounds():
    """Return the true poses of the laser on five rounds, the same drifting, and closures of each onto the first."""
    turns = np.arange(5 * ROUND) * 2.0 * np.pi / ROUND
    radius = 20.0 / np.pi
    true = np.column_stack((radius * np.cos(turns), radius * np.sin(turns), turns))
    true[:, 2] = (true[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    tracked = [SE2.from_array(true[0])]
    for k in range(1, len(true)):
        tracked.append(tracked[-1] @ relative_pose(true, k - 1, k) @ SE2(0.0, 0.0, 0.002))
    closures = [
        MotionEdge(k % ROUND, k, relative_pose(true, k % ROUND, k), np.eye(3)) for k in range(ROUND, len(true), 2)
    ]
    return true, np.array(tracked), closures


@pytest.fixture
def memory(rounds):
    """A memory of these rounds, a keyframe every third reading, that has forgotten what was too much."""
    true, tracked, closures = rounds
    memory = KeyframeBuffer(ForgettingConfig(limit=5 * ROUND, enough=9))
    for number, pose in enumerate(tracked):
        assert not memory.is_full()
        match = ScanMatch(SE2.from_array(pose), 0.9, moved=True, information=np.diag([1e4, 1e2, 1e4]))
        memory.add(TrackedKeyframe.of(3 * number, SCAN, T_ROBOT_SENSOR, match, np.diag([1e4] * 3)))
    assert memory.is_full()
    memory.forget(true, closures)
    return memory


def test_few_rounds_are_kept(memory):
    assert 2 * ROUND <= len(memory.keyframes) < 4 * ROUND
    assert not memory.is_full()
    kept = [k.index for k in memory.keyframes]
    assert packed(memory.keyframes, np.zeros((len(kept), 3))).indices.tolist() == kept
    assert [k.follows_gap for k in memory.keyframes[1:]] == [later > before + 3 for before, later in pairwise(kept)]


def test_steps_stay_as_tracked_and_lead_truly_over_what_was_forgotten(memory, rounds):
    true, tracked, _ = rounds
    numbers = [k.index // 3 for k in memory.keyframes]
    gaps = 0
    for before, after, edge in zip(numbers, numbers[1:], chain(motions(memory.keyframes)), strict=False):
        poses = tracked if after == before + 1 else true
        gaps += after != before + 1
        np.testing.assert_allclose(edge.T_source_target, relative_pose(poses, before, after), atol=1e-9)
    assert gaps > 0


def test_what_was_forgotten_is_where_closing_loops_put_it(memory, rounds):
    true, tracked, _ = rounds
    readings = np.repeat(compose(tracked, np.array(T_ROBOT_SENSOR.inverse())), 3, axis=0)
    numbers = [k.index // 3 for k in memory.keyframes]
    corrected = memory.corrected(readings, true[numbers])[::3]
    expected = compose(true, np.array(T_ROBOT_SENSOR.inverse()))
    kept = np.isin(np.arange(len(true)), numbers)
    np.testing.assert_allclose(corrected[kept], expected[kept], atol=1e-9)
    assert np.hypot(*(corrected - expected)[:, :2].T).max() < 0.01


def test_what_comes_later_goes_on_in_the_same_frame(memory, rounds):
    true, tracked, _ = rounds
    number = len(tracked) - 1
    on = SE2.from_array(tracked[number]) @ SE2(0.5, 0.0, 0.1)
    match = ScanMatch(on, 0.9, moved=True, information=np.diag([1e4, 1e2, 1e4]))
    memory.add(TrackedKeyframe.of(3 * number + 3, SCAN, T_ROBOT_SENSOR, match, np.diag([1e4] * 3)))
    step = memory.keyframes[-2].match.T_map_sensor.inverse() @ memory.keyframes[-1].match.T_map_sensor
    np.testing.assert_allclose(step, (0.5, 0.0, 0.1), atol=1e-9)
    assert len(true) == len(tracked)


@pytest.mark.slow
def test_rounds_without_end_need_no_more_memory():
    """A third of the keyframes are forgotten, and the trajectory is as good as with all of them."""
    laser = SimulatedLaser(beams=180, angle_min=-np.pi / 2, angle_increment=np.pi / 180, rate=5.0)
    endless_rounds = EndlessDrive("round", 600.0, laser, OdometryNoise.preset("good"))
    config = preset("default")
    errors = {}
    for limit in (400, 100_000):
        slam = Slam(config.model_copy(update={"forgetting": ForgettingConfig(limit=limit, enough=8)}))
        for reading in endless_rounds.readings():
            slam.process(reading)
        drive = slam.finish().drives[0]
        np.testing.assert_array_equal(drive.trajectory.poses[drive.keyframes.indices], drive.keyframes.poses)
        truth = endless_rounds.truth().poses
        errors[limit] = np.hypot(*(drive.trajectory.poses - truth)[:, :2].T).max(), len(drive.keyframes)
    assert errors[400][1] < 0.7 * errors[100_000][1]
    assert errors[400][0] < errors[100_000][0] + 0.01
