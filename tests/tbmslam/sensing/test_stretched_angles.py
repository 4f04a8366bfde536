import math

import numpy as np
import pytest

from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.stretched_angles import round_step_deg, unstretched


@pytest.mark.parametrize(
    ("beams", "stated", "step"),
    [
        (180, 180 / 179, 1.0),
        (360, 180 / 359, 0.5),
        (180, -180 / 179, 1.0),
        (720, 180 / 719, 0.25),
        (361, 0.5, None),
        (181, 1.0, None),
        (180, 1.0, None),
        (180, 1.003, None),
        (1, 1.0, None),
        (0, 0.0, None),
    ],
)
def test_the_step_before_it_was_stretched(beams, stated, step):
    assert round_step_deg(beams, math.radians(stated)) == step
    scan = LaserScan(0.0, -0.5 * math.pi, math.radians(stated), 0.0, 30.0, np.ones(beams))
    if step is None:
        assert unstretched(scan) is scan
    else:
        assert unstretched(scan).angle_increment == pytest.approx(math.radians(math.copysign(step, stated)))
        assert unstretched(scan).angle_min == scan.angle_min
