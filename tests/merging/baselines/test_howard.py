import math

import numpy as np
import pytest

from merging.baselines.howard import Encounter, align, measured
from tbmslam.geometry.se2 import SE2

TRUE = SE2(4.0, -2.0, 1.1)


def test_an_exact_measurement_gives_the_transform():
    robot, other = SE2(1.0, 2.0, 0.3), SE2(-2.0, 0.5, -2.0)
    answer = align([Encounter(robot, robot.inverse() @ TRUE @ other, other)])
    assert answer.accepted
    assert answer.reason == "the robots met 1 time"
    np.testing.assert_allclose(answer.T_target_source, TRUE, atol=1e-12)


def test_robots_that_never_met_stay_apart():
    answer = align([])
    assert not answer.accepted
    assert answer.T_target_source is None
    assert answer.reason == "the robots never met"


def test_errors_of_many_encounters_average_out():
    rng = np.random.default_rng(4)
    others = [SE2(float(x), float(y), 0.4) for x, y in rng.uniform(-5, 5, (60, 2))]
    encounters = [measured(TRUE @ other @ SE2(1.0, 0.0, 2.0), other, TRUE, rng) for other in others]
    errors = [math.hypot(*(TRUE.inverse() @ align([one]).T_target_source)[:2]) for one in encounters]
    together = align(encounters).T_target_source
    assert math.hypot(*(TRUE.inverse() @ together)[:2]) < 0.3 * np.mean(errors)
    assert together.theta == pytest.approx(TRUE.theta, abs=0.01)
