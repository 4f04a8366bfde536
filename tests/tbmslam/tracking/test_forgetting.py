import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.tracking.forgetting import ForgettingConfig, may_be_forgotten

CONFIG = ForgettingConfig(enough=9)
ROUND = 80


def rounds(count):
    """Return poses every half metre on a circle of 40 m round, that many times, and closures onto the first."""
    turns = np.arange(count * ROUND) * 2.0 * np.pi / ROUND
    radius = 20.0 / np.pi
    poses = np.column_stack((radius * np.cos(turns), radius * np.sin(turns), turns))
    closures = [MotionEdge(k % ROUND, k, SE2.identity(), np.eye(3)) for k in range(ROUND, len(poses), 2)]
    return poses, closures


def test_rounds_beyond_the_enough_are_forgotten():
    poses, closures = rounds(5)
    gone = may_be_forgotten(poses, closures, 0, len(poses), CONFIG)
    assert not gone[: 2 * ROUND].any()
    assert gone[3 * ROUND : -20].all()


def test_nothing_is_forgotten_where_all_is_new():
    poses = np.column_stack((0.5 * np.arange(400), np.zeros(400), np.zeros(400)))
    assert not may_be_forgotten(poses, [], 0, 400, CONFIG).any()


def test_what_was_laid_onto_nothing_is_kept():
    poses, _ = rounds(5)
    assert not may_be_forgotten(poses, [], 0, len(poses), CONFIG).any()


def test_what_others_were_laid_onto_is_kept():
    poses, closures = rounds(5)
    anchor = 4 * ROUND
    closures.append(MotionEdge(anchor, anchor + 40, SE2.identity(), np.eye(3)))
    gone = may_be_forgotten(poses, closures, 0, len(poses), CONFIG)
    assert not gone[anchor - 15 : anchor + 15].any()
    assert gone[3 * ROUND + 10 : anchor - 40].all()


def test_what_is_settled_or_too_young_is_kept():
    poses, closures = rounds(6)
    gone = may_be_forgotten(poses, closures, 4 * ROUND, 5 * ROUND, CONFIG)
    assert not gone[: 4 * ROUND].any()
    assert gone[4 * ROUND + 10 : 5 * ROUND - 20].all()
    assert not gone[5 * ROUND :].any()


def test_the_other_way_round_is_another_view():
    poses, closures = rounds(5)
    poses[3 * ROUND :, 2] += np.pi
    gone = may_be_forgotten(poses, closures, 0, len(poses), CONFIG)
    assert not gone[3 * ROUND :].any()
