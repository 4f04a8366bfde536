import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure.open_direction import open_direction, without_open_direction


def test_an_undetermined_direction_has_no_information():
    turn = SE2(0.0, 0.0, 0.4).matrix()
    open_along, shut = (turn @ np.diag([along, 1e6, 1e5]) @ turn.T for along in (10.0, 5e5))
    assert open_direction(shut, 0.02) is None
    np.testing.assert_array_equal(without_open_direction(shut, 0.02), shut)
    direction = open_direction(open_along, 0.02)
    np.testing.assert_allclose(abs(direction @ turn[:2, 0]), 1.0)
    kept = without_open_direction(open_along, 0.02)
    np.testing.assert_allclose(turn.T @ kept @ turn, np.diag([0.0, 1e6, 1e5]), atol=1e-6)
