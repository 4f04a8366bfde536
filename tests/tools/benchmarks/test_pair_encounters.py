import math

import numpy as np
import pytest

from merging.baselines import howard
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tools.benchmarks.pair_encounters import encounters_of
from tools.map_pairs.files import KnownPair

TRUE = SE2(1.0, 0.5, 0.4)


def room(free):
    masses = np.tile(np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32), (60, 60, 1))
    masses[free] = (0.0, 0.9, 0.0, 0.1)
    return TbmMap(TbmGrid(GridGeometry(0.1, 0.0, 0.0, 60, 60), masses))


def test_robots_meet_where_both_know_free_space_and_measure_with_noise():
    pair = KnownPair("room", room(np.s_[10:50, 10:50]), room(np.s_[10:50, 10:50]), TRUE, 0.9)
    (met,) = encounters_of(pair)
    assert encounters_of(pair) == [met]
    assert math.hypot(met.T_robot_other.x, met.T_robot_other.y) < 3.0 + 0.3
    for pose in (met.T_target_robot, met.T_source_other):
        assert 1.0 < pose.x < 5.0
        assert 1.0 < pose.y < 5.0
    found = howard.align([met]).T_target_source
    assert 0.0 < math.dist(found[:2], TRUE[:2]) < 0.5
    assert found.theta == pytest.approx(TRUE.theta, abs=math.radians(4.0))


def test_robots_do_not_meet_in_different_places():
    free = room(np.s_[10:50, 10:50])
    assert encounters_of(KnownPair("foreign", free, free, None, 0.0)) == []
    assert encounters_of(KnownPair("apart", free, free, SE2(20.0, 0.0, 0.0), 0.0)) == []
