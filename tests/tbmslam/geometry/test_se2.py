"""Rigid motions on values that can be checked by hand; the group laws are in tests/properties."""

import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import (
    SE2,
    compose,
    interpolate,
    inverse,
    laid_out,
    median_pose,
    stacked,
    wrap_angle,
    wrap_angles,
)

QUARTER = math.pi / 2


def test_a_product_moves_in_the_frame_of_its_first_factor():
    assert SE2(1.0, 2.0, QUARTER) @ SE2(3.0, 0.0, QUARTER) == pytest.approx((1.0, 5.0, -math.pi))


@pytest.mark.parametrize("heading", [-3.0, 0.3, 3.0])
def test_a_pose_seen_from_another_is_the_motion_to_it(heading):
    here, there = SE2(1.0, 2.0, heading), SE2(-0.5, 4.0, -2.5)
    assert here.to(there) == pytest.approx(here.inverse() @ there)
    assert here @ here.to(there) == pytest.approx(there)


def test_apply_carries_points_of_any_shape():
    pose = SE2(1.0, 2.0, QUARTER)
    np.testing.assert_allclose(pose.apply([1.0, 0.0]), [1.0, 3.0])
    np.testing.assert_allclose(pose.apply(np.zeros((2, 3, 2))), np.tile([1.0, 2.0], (2, 3, 1)))


def test_the_exponential_drives_an_arc():
    """A quarter turn to the left on a circle of radius 2."""
    assert SE2.exp(math.pi, 0.0, QUARTER) == pytest.approx((2.0, 2.0, QUARTER))
    assert SE2(2.0, 2.0, QUARTER).log() == pytest.approx((math.pi, 0.0, QUARTER))


def test_halfway_along_an_arc_lies_on_the_arc():
    middle = SE2.identity().interpolate(SE2(2.0, 2.0, QUARTER), 0.5)
    assert middle == pytest.approx((math.sqrt(2.0), 2.0 - math.sqrt(2.0), math.pi / 4))


def test_reading_from_arrays_and_matrices():
    assert SE2.from_array(np.array([1, 2, 3])) == (1.0, 2.0, 3.0)
    assert SE2.from_matrix(np.array([[0.0, -1.0, 5.0], [1.0, 0.0, 6.0], [0.0, 0.0, 1.0]])) == (5.0, 6.0, QUARTER)
    assert all(type(value) is float for value in SE2.from_array(np.array([1, 2, 3])))


@pytest.mark.parametrize("values", [[1.0, 2.0], [1.0, 2.0, 3.0, 4.0]])
def test_a_pose_has_three_numbers(values):
    with pytest.raises(ValueError, match="values to unpack"):
        SE2.from_array(values)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (math.pi, -math.pi), (-math.pi, -math.pi), (3 * math.pi / 2, -QUARTER), (7.0, 7.0 - 2 * math.pi)],
)
def test_angles_wrap_to_minus_pi_included_and_pi_not(angle, wrapped):
    assert wrap_angle(angle) == pytest.approx(wrapped)
    np.testing.assert_allclose(wrap_angles([[angle]]), [[wrapped]])


@pytest.mark.parametrize("poses", [[], [SE2(1.0, 2.0, 3.0), (4, 5.0, math.nan)]])
def test_stacked_poses_are_rows(poses):
    np.testing.assert_array_equal(stacked(poses), np.array(poses, dtype=np.float64).reshape(-1, 3))


def test_arrays_of_motions_are_composed_one_by_one():
    generator = np.random.default_rng(0)
    first, second = generator.normal(0.0, 3.0, (2, 20, 3))
    each = [SE2.from_array(a) @ SE2.from_array(b) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(np.exp(1j * compose(first, second)[:, 2]), np.exp(1j * np.array(each)[:, 2]))
    np.testing.assert_allclose(compose(first, second)[:, :2], np.array(each)[:, :2])
    np.testing.assert_allclose(compose(first, inverse(first)), 0.0, atol=1e-12)


def test_arrays_of_motions_are_interpolated_one_by_one():
    generator = np.random.default_rng(1)
    begins, ends = generator.normal(0.0, 3.0, (2, 30, 3))
    ends[:5, 2] = begins[:5, 2] + [0.0, 1e-9, -1e-5, 1e-3, 1e-4]
    shares = generator.random(30)
    each = [SE2.from_array(a).interpolate(SE2.from_array(b), s) for a, b, s in zip(begins, ends, shares, strict=True)]
    found = interpolate(begins, ends, shares)
    np.testing.assert_allclose(found[:, :2], np.array(each)[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angles(found[:, 2] - np.array(each)[:, 2]), 0.0, atol=1e-9)


def test_poses_are_laid_out_along_steps():
    start, steps = SE2(1.0, 2.0, 3.0), [SE2(0.5, 0.1, 0.4), SE2(0.2, -0.3, -0.1), SE2(0.0, 0.0, 2.0)]
    poses = [start]
    for step in steps:
        poses.append(poses[-1] @ step)
    np.testing.assert_allclose(laid_out(np.array(start), stacked(steps)), stacked(poses), atol=1e-12)
    np.testing.assert_array_equal(laid_out(np.array(start), np.zeros((0, 3))), [start])


@pytest.mark.parametrize("turn", [0.0, math.pi])
def test_the_median_of_poses_is_among_them_wherever_they_face(turn):
    poses = np.array([[1.0 + x, 2.0, wrap_angle(turn + x)] for x in (-0.02, 0.01, -0.01, 0.03)])
    np.testing.assert_allclose(median_pose(poses), (1.0, 2.0, wrap_angle(turn)), atol=5e-4)
    np.testing.assert_allclose(median_pose(poses[:1]), poses[0], atol=1e-12)
