import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.local_frame import FAR_M, LocalFrame
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan, Reading

SCAN = LaserScan(0.0, 0.0, 0.1, 0.1, 10.0, np.full(5, 2.0))
FAR = SE2(512_345.4, -4_600_000.7, 1.0)
BARE = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 1.0, -2.0, 4, 4)))


@pytest.mark.parametrize("pose", [None, SE2(FAR_M, -FAR_M, 1.0)])
def test_a_frame_near_by_stays(pose):
    frame = LocalFrame.around(pose)
    reading = Reading(SCAN, pose, SE2.identity())
    assert not frame.is_far
    assert frame.reading(reading) is reading
    assert frame.pose_there(SE2(1.0, 2.0, 3.0)) == SE2(1.0, 2.0, 3.0)
    assert frame.map_there(BARE) is BARE


def test_a_far_frame_is_shifted_by_whole_metres_there_and_back():
    frame = LocalFrame.around(FAR)
    assert frame.T_far_near == SE2(512_345.0, -4_600_001.0, 0.0)
    near = frame.reading(Reading(SCAN, FAR, SE2.identity())).T_odom_robot
    assert near == pytest.approx(SE2(0.4, 0.3, 1.0), abs=1e-6)
    assert frame.pose_there(near) == pytest.approx(FAR)
    there = frame.map_there(BARE).grid
    assert there.geometry == GridGeometry(0.05, 512_346.0, -4_600_003.0, 4, 4)
    assert there.masses is BARE.grid.masses
