import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2

coordinate = st.floats(-20.0, 20.0)


@st.composite
def motions(draw):
    axis_angle = [draw(st.floats(-3.0, 3.0)) for _ in range(3)]
    return SE3(*(draw(coordinate) for _ in range(3)), *map(float, Rotation.from_rotvec(axis_angle).as_quat()))


def matrix(motion):
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(motion[3:]).as_matrix()
    result[:3, 3] = motion[:3]
    return result


@given(motions(), motions())
def test_product_and_inverse_agree_with_matrices(a, b):
    assert matrix(a @ b) == pytest.approx(matrix(a) @ matrix(b), abs=1e-9)
    assert matrix(a.inverse()) == pytest.approx(np.linalg.inv(matrix(a)), abs=1e-9)


@given(motions(), motions(), st.floats(0.0, 1.0))
def test_interpolation_agrees_with_scipy(a, b, fraction):
    found = a.interpolate(b, fraction)
    expected = Slerp([0.0, 1.0], Rotation.from_quat([a[3:], b[3:]]))(fraction)
    difference = (Rotation.from_quat(found[3:]).inv() * expected).magnitude()
    between = (Rotation.from_quat(a[3:]).inv() * Rotation.from_quat(b[3:])).magnitude()
    if between < math.pi - 1e-3:  # half a turn has two shortest ways
        assert difference == pytest.approx(0.0, abs=1e-6)
    assert np.array(found[:3]) == pytest.approx((1.0 - fraction) * np.array(a[:3]) + fraction * np.array(b[:3]))


@given(coordinate, coordinate, st.floats(-3.1, 3.1))
def test_planar_motions_survive(x, y, theta):
    assert SE3.from_planar(SE2(x, y, theta)).planar() == pytest.approx(SE2(x, y, theta), abs=1e-9)


def test_up_distinguishes_upright_from_upside_down():
    assert SE3.identity().up() == 1.0
    assert SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0).up() == -1.0


@pytest.mark.parametrize("values", [(0, 0, 0, 0, 0, 0, 0), (math.nan, 0, 0, 0, 0, 0, 1), (0, 0, 0, 0, math.inf, 0, 1)])
def test_what_is_no_motion_is_none(values):
    assert SE3.from_values(*map(float, values)) is None


def test_quaternions_are_normalised():
    assert SE3.from_values(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 2.0) == SE3(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
