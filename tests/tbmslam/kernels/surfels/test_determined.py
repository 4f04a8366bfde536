import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.surfels.determined import determined_of_robot, determined_shares, prior_information, seen_by_robot
from tests import reference

small = st.floats(0.01, 1.0)
deviations_of = st.tuples(small, small, small)
headings = st.floats(-math.pi, math.pi)
mounts = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), headings)
roots = arrays(np.float64, (3, 3), elements=st.floats(-30.0, 30.0))


@given(roots, arrays(np.float64, 3, elements=small))
def test_shares_are_the_diagonal_of_a_gain(root, deviations):
    information = root.T @ root
    gain = np.linalg.solve(information + np.diag(deviations**-2.0), information)
    np.testing.assert_allclose(determined_shares(information, deviations), np.diag(gain), atol=1e-6)


def test_nothing_measured_determines_nothing():
    assert determined_shares(np.zeros((3, 3)), np.array([0.01, 0.01, 0.005])) == (0.0, 0.0, 0.0)


@given(roots, deviations_of, headings, mounts)
def test_shares_of_the_robots_pose_are_those_of_what_it_saw(root, deviations, heading, mount):
    information = root.T @ root
    expected = determined_shares(seen_by_robot(information, heading, mount), deviations)
    assert determined_of_robot(information, deviations, heading, mount) == expected


@given(deviations_of, headings, mounts)
def test_a_prior_of_the_robot_is_one_of_its_laser(deviations, heading, mount):
    found = prior_information(deviations, heading, mount)
    expected = reference.prior_information(deviations, heading, mount)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_array_equal(found, found.T)


@given(roots, headings, mounts)
def test_what_the_laser_saw_is_seen_by_the_robot(root, heading, mount):
    information = root.T @ root
    found = seen_by_robot(information, heading, mount)
    expected = reference.seen_by_robot(information, heading, mount)
    np.testing.assert_allclose(found, expected, atol=1e-7 * max(np.abs(expected).max(), 1.0))


@given(deviations_of, headings, mounts)
def test_both_are_inverse_to_each_other(deviations, heading, mount):
    there = prior_information(deviations, heading, mount)
    back = seen_by_robot(there, heading, mount)
    np.testing.assert_allclose(back, np.diag(np.square(deviations) ** -1.0), rtol=1e-6, atol=1e-9 * np.abs(there).max())


@pytest.mark.parametrize("turn", [1e-4, -1e-4])
def test_a_turn_of_the_robot_alone_costs_what_its_heading_does(turn):
    """Whatever way the laser takes on its lever."""
    robot, mount = SE2(3.0, -2.0, 0.7), SE2(0.8, -0.5, 1.0)
    before, after = robot @ mount, robot @ SE2(0.0, 0.0, turn) @ mount
    step = np.subtract(after, before)
    information = prior_information((0.001, 0.002, 0.1), robot.theta, (*mount,))
    assert step @ information @ step == pytest.approx((turn / 0.1) ** 2, rel=1e-2)


def test_an_unseen_direction_stays_unseen_by_the_robot():
    """A wall along the robot's way, seen by a laser that looks to its side."""
    heading, mount = 0.9, (0.3, 0.2, math.pi / 2.0)
    normal = np.array([-math.sin(heading), math.cos(heading)])
    information = np.zeros((3, 3))
    information[:2, :2] = 1e6 * np.outer(normal, normal)
    seen = seen_by_robot(information, heading, mount)
    shares = determined_shares(seen, np.array([0.02, 0.02, 0.01]))
    assert shares[0] == pytest.approx(0.0, abs=1e-6)
    assert shares[1] > 0.9
