import numpy as np
import pytest

from tbmslam.evaluation.systematic_error import systematic_error
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.geometry.trajectory import Trajectory


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


def test_a_truth_of_the_laser_is_named(estimate):
    said = systematic_error(true(estimate, (0.26, -0.05, 0.3)), estimate, 0.01)
    assert said is not None
    assert said.startswith("a point +0.26")
    assert "m ahead and -0.0" in said
    assert said.endswith("the truth may be that of the laser: pass --frame laser")


@pytest.mark.parametrize("seconds", [-2.0, 0.6, 3.0])
def test_a_clock_that_differs_is_named(estimate, seconds):
    said = systematic_error(true(estimate, seconds=seconds), estimate, 0.026)
    assert said is not None
    assert said.startswith(f"stamps {seconds:+.2f} s later fit the truth to 0.0")


def test_a_good_estimate_needs_no_explanation(estimate):
    assert systematic_error(true(estimate), estimate, 0.01) is None


def test_nothing_constant_explains_an_estimate_that_drifts(estimate, generator):
    wrong = estimate.poses + np.cumsum(generator.normal(0.0, [0.01, 0.01, 0.002], estimate.poses.shape), axis=0)
    assert systematic_error(true(estimate), Trajectory(estimate.stamps, wrong), 0.01) is None


def test_two_poses_explain_nothing(estimate):
    few = Trajectory(estimate.stamps[:2], estimate.poses[:2])
    assert systematic_error(true(estimate, (0.3, 0.0, 0.0)), few, 0.01) is None
