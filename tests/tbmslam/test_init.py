import numpy as np
import pytest

import tbmslam
from tests.processes import python


def test_the_class_of_errors_is_loaded_without_compiled_code():
    code = "import sys, tbmslam; tbmslam.TbmSlamError; print({'numpy', 'numba'} & set(sys.modules))"
    assert python("-c", code).stdout == "set()\n"


def test_a_map_is_made_of_arrays_without_a_file():
    slam = tbmslam.Slam(name="mine")
    for step in range(4):
        scan = tbmslam.LaserScan(
            stamp=0.1 * step,
            angle_min=-1.5,
            angle_increment=0.01,
            range_min=0.1,
            range_max=10.0,
            ranges=np.full(300, 3.0),
        )
        pose = slam.process(tbmslam.Reading(scan, T_odom_robot=tbmslam.SE2(0.0, 0.0, 0.0)))
    assert pose == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    made = slam.finish()
    assert made.grid.is_known().any()
    assert len(made.drives[0].trajectory) == 4
