import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import UNKNOWN
from tbmslam.evaluation.map_refinement import MapRefinementError, refine_map_transform
from tbmslam.geometry.se2 import SE2


@pytest.mark.parametrize("guess_error", [SE2(0.0, 0.0, 0.0), SE2(0.5, -0.4, 0.03), SE2(-0.3, 0.6, -0.05)])
def test_a_part_of_a_world_is_laid_on_the_whole(guess_error):
    world = make_world("apartment", 3)
    geometry = world.grid(0.05)
    T_world_map = SE2(4.0, 7.0, 0.7)
    own = GridGeometry(0.05, 0.0, 0.0, 120, 160)
    labels = world.occupancy(own, T_world_map)
    found = refine_map_transform(labels, own, world.occupancy(geometry), geometry, T_world_map @ guess_error)
    left = T_world_map.inverse() @ found
    assert np.hypot(left.x, left.y) < 0.02
    assert abs(np.degrees(left.theta)) < 0.2


def test_a_map_without_walls():
    geometry = GridGeometry(0.05, 0.0, 0.0, 4, 4)
    nothing = np.full((4, 4), UNKNOWN, dtype=np.uint8)
    with pytest.raises(MapRefinementError, match="one of the maps has no occupied cell to refine the transform by"):
        refine_map_transform(nothing, geometry, nothing, geometry, SE2.identity())
