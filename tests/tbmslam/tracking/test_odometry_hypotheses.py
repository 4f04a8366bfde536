"""The hypotheses about the odometry at a scan."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.odometry_fault import RESTART_COST, OdometryFault, faulty_cost
from tbmslam.tracking.odometry_hypotheses import OdometryHypotheses, PoseBelief, may_be_faulty
from tbmslam.tracking.student_t import student_cost
from tbmslam.tracking.tracker import Coasting, PosePrior

RIGHT, WIDE = (0.02, 0.01, 0.01), (0.2, 0.2, 0.3)
MEAN, MOUNT = SE2(1.0, 2.0, 0.5), SE2(0.2, 0.0, math.pi)
INERTIA = Coasting(SE2(0.5, 2.0, 0.4), WIDE)


def prior_at(mean=MEAN, inertia=INERTIA, **more):
    return PosePrior(mean, RIGHT, RIGHT, mean, lambda: inertia, **{"by_odometry": True, **more})


def hypotheses_of(prior, fault=None):
    return OdometryHypotheses.of(prior, MOUNT, fault or OdometryFault())


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0))
def test_a_distance_is_that_of_the_robot_s_pose(heading, along, across, turn):
    """To first order in the rotation, which the lever of the laser multiplies."""
    mean = SE2(1.0, -2.0, heading)
    belief = PoseBelief.of(mean, RIGHT, MOUNT)
    moved = mean @ SE2(along, across, 1e-4 * turn) @ MOUNT
    stated = (along / RIGHT[0]) ** 2 + (across / RIGHT[1]) ** 2 + (1e-4 * turn / RIGHT[2]) ** 2
    assert belief.squared_distance(moved) == pytest.approx(stated, rel=1e-3, abs=1e-2)


def test_one_search_covers_starts_that_are_near_in_place_and_heading():
    belief = PoseBelief.of(MEAN, RIGHT, MOUNT)
    assert belief.is_near(PoseBelief.of(MEAN @ SE2(0.0, 0.03, 0.0), RIGHT, MOUNT))
    assert not belief.is_near(PoseBelief.of(MEAN @ SE2(0.0, 0.06, 0.0), RIGHT, MOUNT))
    assert not belief.is_near(PoseBelief.of(MEAN @ MOUNT @ SE2(0.0, 0.0, 0.06) @ MOUNT.inverse(), RIGHT, MOUNT))


def test_usual_odometry_is_right_whatever_inertia_says():
    found = hypotheses_of(prior_at(swerve=0.05))
    assert not found.is_suspected
    assert found.cost(MEAN @ MOUNT, 3.0, OdometryFault()) == student_cost(3.0)
    assert found.costs(MEAN @ MOUNT, 3.0) == (3.0, faulty_cost(RIGHT, WIDE), math.inf)


def test_odometry_that_leaves_the_last_motion_may_be_faulty():
    """Then a pose near that of inertia is likely, though it is far from the odometry."""
    prior, fault = prior_at(swerve=0.5), OdometryFault()
    assert may_be_faulty(prior, fault)
    found = hypotheses_of(prior)
    by_inertia, beyond = INERTIA.mean @ MOUNT, SE2(1.5, 2.0, 0.6) @ MOUNT  # equally far from the odometry
    costs = [found.cost(pose, found.right.squared_distance(pose), fault) for pose in (by_inertia, beyond)]
    assert costs[1] - costs[0] == pytest.approx(student_cost(found.inertia.squared_distance(beyond)), abs=0.1)
    assert costs[0] < student_cost(found.right.squared_distance(by_inertia))


def test_without_inertia_faulty_odometry_leaves_no_pose():
    found = hypotheses_of(prior_at(inertia=None, swerve=0.5))
    assert found.inertia is None
    assert found.costs(MEAN, 7.0) == (7.0, math.inf, math.inf)
    assert found.cost(MEAN, 7.0, OdometryFault()) == student_cost(7.0)


def test_odometry_that_began_anew_is_as_rare_as_a_fault_and_as_wide_as_a_start():
    stood = Coasting(SE2(4.0, 4.0, 1.0), WIDE)
    found = hypotheses_of(prior_at(stood=stood))
    assert found.is_suspected
    assert found.returned.mean == stood.mean @ MOUNT
    dearer = RESTART_COST + math.log(math.prod(WIDE) / math.prod(RIGHT))
    assert found.costs(stood.mean @ MOUNT, 1e4)[2] == pytest.approx(dearer)


def test_after_a_fault_the_odometry_may_be_again_as_before():
    fault, by_odometry = OdometryFault(), SE2(0.0, 0.0, 1.4)
    fault.observe(1e4, 0.0)
    fault.remember(by_odometry, SE2.identity(), RIGHT)
    found = hypotheses_of(prior_at(), fault)
    np.testing.assert_allclose(found.returned.mean, by_odometry @ MEAN @ MOUNT, atol=1e-12)
    # Twice the variances: those of the fault's keyframe, and those since then.
    assert found.costs(found.returned.mean, 1e4)[2] == pytest.approx(1.5 * math.log(2.0))
    assert hypotheses_of(prior_at(by_odometry=False), fault).returned is None
