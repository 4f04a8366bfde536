"""Motions between points of view, linearised as one would by hand."""

import math

import numpy as np
import pytest

from tbmslam.kernels.adjustment.motion_systems import Motions, motion_equations

POSES = 4
ENDS = np.array([[0, 1], [1, 2], [3, 0], [2, 2], [0, 1]])
STEP = 1e-6


def matrix(pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])


def plain_error(motions, e, poses):
    """Return the error (3,) of a motion in its target's frame as measured, by whole matrices."""
    source, target = (
        matrix(poses[pose]) @ matrix(lever) for pose, lever in zip(motions.ends[e], motions.levers[e], strict=True)
    )
    found, measured = np.linalg.inv(source) @ target, motions.measured[e]
    way = matrix(measured)[:2, :2].T @ (found[:2, 2] - measured[:2])
    turn = math.atan2(found[1, 0], found[0, 0]) - measured[2]
    return np.array([*way, math.remainder(turn, math.tau)])


def plain_slopes(motions, e, poses):
    """Return how the error of a motion changes with all poses (3, 3 N), by small steps."""
    slopes = np.zeros((3, poses.size))
    for number in range(poses.size):
        step = np.zeros(poses.size)
        step[number] = STEP
        step = step.reshape(poses.shape)
        slopes[:, number] = plain_error(motions, e, poses + step) - plain_error(motions, e, poses - step)
    return slopes / (2.0 * STEP)


def plain_equations(motions, poses):
    """Return the whole curvature (3 N, 3 N) and the gradient (N, 3)."""
    curvature, gradient = np.zeros((poses.size, poses.size)), np.zeros(poses.size)
    for e in range(len(motions.ends)):
        error, slopes = plain_error(motions, e, poses), plain_slopes(motions, e, poses)
        information = motions.informations[e]
        say = 1.0 / (1.0 + error @ information @ error / motions.widths[e] ** 2)
        curvature += say * slopes.T @ information @ slopes
        gradient += say * slopes.T @ information @ error
    return curvature, gradient.reshape(-1, 3)


def whole(own, system):
    """Return the curvature (3 N, 3 N) that is kept in blocks."""
    blocks = np.zeros((len(own), 3, len(own), 3))
    for k, block in enumerate(own):
        blocks[k, :, k] += block
    for (source, target), across in zip(system.ends, system.across, strict=True):
        blocks[source, :, target] += across
        blocks[target, :, source] += across.T
    return blocks.reshape(3 * len(own), -1)


@pytest.fixture
def poses(generator):
    return np.column_stack((generator.uniform(-3.0, 3.0, (POSES, 2)), generator.uniform(-3.0, 3.0, POSES)))


@pytest.fixture
def motions(generator):
    count = len(ENDS)
    roots = generator.normal(size=(count, 3, 3))
    return Motions(
        ends=ENDS,
        levers=generator.uniform(-1.5, 1.5, (count, 2, 3)),
        measured=generator.uniform(-2.0, 2.0, (count, 3)),
        informations=roots @ roots.transpose(0, 2, 1) + np.eye(3),
        widths=np.array([np.inf, 2.0, 0.5, 3.0, 1.0]),
    )


def test_the_equations_are_those_of_the_plain_twin(motions, poses):
    curvature, gradient = plain_equations(motions, poses)
    own, system, found = motion_equations(motions, poses)
    np.testing.assert_allclose(found, gradient, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(whole(own, system), curvature, rtol=1e-6, atol=1e-6)


def test_a_motion_within_one_pose_counts_in_its_own_block_alone(motions, poses):
    own, system, _ = motion_equations(motions, poses)
    within = int(np.flatnonzero(ENDS[:, 0] == ENDS[:, 1])[0])
    assert not system.across[within].any()
    np.testing.assert_allclose(own, own.transpose(0, 2, 1), atol=1e-9)


def test_a_turn_across_half_a_circle_is_a_small_error():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, math.pi - 0.01]])
    motions = Motions(
        ends=np.array([[0, 1]]),
        levers=np.zeros((1, 2, 3)),
        measured=np.array([[1.0, 0.0, 0.01 - math.pi]]),
        informations=np.eye(3)[None],
        widths=np.array([np.inf]),
    )
    _, _, gradient = motion_equations(motions, poses)
    np.testing.assert_allclose(gradient[:, 2], [0.02, -0.02], atol=1e-12)


def test_no_motions_say_nothing(poses):
    none = Motions(
        np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
    )
    own, system, gradient = motion_equations(none, poses)
    assert own.shape == (POSES, 3, 3)
    assert len(system.ends) == len(system.across) == 0
    assert not own.any()
    assert not gradient.any()
