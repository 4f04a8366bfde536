"""SE(2) is a group, its logarithm inverts its exponential, and interpolation follows a constant twist."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.geometry.se2 import SE2, wrap_angle, wrap_angles

lengths = st.floats(-1e3, 1e3)
poses = st.builds(SE2, lengths, lengths, st.floats(-10.0, 10.0))
# The logarithm jumps at half a turn, so the laws about it stay clear of that.
twists = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1))
small_turns = st.floats(-1e-3, 1e-3)
points = st.lists(st.tuples(lengths, lengths), min_size=1, max_size=5)


def assert_same(first, second, tolerance=1e-7):
    np.testing.assert_allclose(first[:2], second[:2], rtol=0, atol=tolerance)
    assert abs(wrap_angle(first[2] - second[2])) < 1e-9


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_same((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_identity_and_inverse(pose):
    assert_same(pose @ SE2.identity(), pose)
    assert_same(SE2.identity() @ pose, pose)
    assert_same(pose @ pose.inverse(), SE2.identity())
    assert_same(pose.inverse() @ pose, SE2.identity())
    assert_same(pose.inverse().inverse(), pose)


@given(poses, poses)
def test_the_inverse_of_a_product_is_the_product_of_inverses_turned_around(a, b):
    assert_same((a @ b).inverse(), b.inverse() @ a.inverse())


@given(poses, poses, points)
def test_applying_a_product_applies_one_after_the_other(a, b, cloud):
    np.testing.assert_allclose((a @ b).apply(cloud), a.apply(b.apply(cloud)), rtol=0, atol=1e-7)


@given(poses, points)
def test_distances_stay(pose, cloud):
    before, after = np.array(cloud), pose.apply(cloud)
    np.testing.assert_allclose(
        np.linalg.norm(after - after[0], axis=1), np.linalg.norm(before - before[0], axis=1), rtol=0, atol=1e-8
    )


@given(poses, poses, points)
def test_matrices_say_the_same(a, b, cloud):
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), rtol=0, atol=1e-7)
    assert_same(SE2.from_matrix(a.matrix()), a)
    homogeneous = np.column_stack((cloud, np.ones(len(cloud))))
    np.testing.assert_allclose(a.apply(cloud), (homogeneous @ a.matrix().T)[:, :2], rtol=0, atol=1e-9)


@given(twists)
def test_log_inverts_exp(twist):
    np.testing.assert_allclose(SE2.exp(*twist).log(), twist, rtol=0, atol=1e-8)


@given(poses)
def test_exp_inverts_log(pose):
    assert_same(SE2.exp(*pose.log()), pose, tolerance=1e-6)


@given(st.floats(-50, 50), st.floats(-50, 50), small_turns)
def test_exp_has_no_seam_where_the_series_begins(vx, vy, omega):
    """Small turns against the matrix exponential's series."""
    generator = np.array([[0.0, -omega, vx], [omega, 0.0, vy], [0.0, 0.0, 0.0]])
    series, power = np.eye(3), np.eye(3)
    for n in range(1, 6):
        power = power @ generator / n
        series = series + power
    np.testing.assert_allclose(SE2.exp(vx, vy, omega).matrix(), series, rtol=0, atol=1e-9)


@given(twists, st.floats(0, 1), st.floats(0, 1))
def test_twists_along_one_axis_add_up(twist, s, t):
    vx, vy, omega = twist
    both = SE2.exp(s * vx, s * vy, s * omega) @ SE2.exp(t * vx, t * vy, t * omega)
    assert_same(both, SE2.exp((s + t) * vx, (s + t) * vy, (s + t) * omega))


@given(poses, twists)
def test_interpolation_begins_and_ends_at_its_poses(start, twist):
    end = start @ SE2.exp(*twist)
    assert_same(start.interpolate(end, 0.0), start)
    assert_same(start.interpolate(end, 1.0), end)


@given(poses, poses, twists, st.floats(0, 1))
def test_interpolation_does_not_depend_on_the_frame(frame, start, twist, fraction):
    end = start @ SE2.exp(*twist)
    assert_same((frame @ start).interpolate(frame @ end, fraction), frame @ start.interpolate(end, fraction), 1e-6)


@given(st.floats(-1e6, 1e6))
def test_wrapped_angles_point_the_same_way_within_one_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped - angle), 1.0, abs_tol=1e-9)
    assert abs(wrap_angle(float(wrap_angles(angle)) - wrapped)) < 1e-9
