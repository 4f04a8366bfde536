"""Two maps of one floor with different deformations, as from different years."""

from functools import cache

import numpy as np

from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import building_of_world
from merging import align
from merging.alignment import Alignment
from merging.rigid_alignment import align_whole
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tests.merging.conftest import grid_of_occupancy


@cache
def bent_maps(kind: str, bend_m: float = 0.6) -> tuple[TbmMap, TbmMap, SE2]:
    """Return a target and a source of a building of some kind, and T_target_source before any bending."""
    floor = building_of_world(kind, 3, 0.1)
    made, frames = list[TbmMap](), list[SE2]()
    for number in range(2):
        distortion = Distortion(
            turn=0.4 + 1.1 * number, deformation_m=bend_m, wavelength_m=40.0, raggedness=0.3, missing=0.05, moved=1.0,
            clutter=2.0, blobs=1.0, speckle=0.001,
        )  # fmt: skip
        distorted = distortion.distort(floor.occupancy, floor.resolution, np.random.default_rng(number))
        origin = (5.0 * number, -3.0 * number)
        made.append(TbmMap(grid_of_occupancy(distorted.occupancy, floor.resolution, origin)))
        frames.append(SE2(*origin, 0.0) @ distorted.T_map_building)
    return made[0], made[1], frames[0] @ frames[1].inverse()


@cache
def rigid_of(kind: str, bend_m: float = 0.6) -> Alignment:
    """Return the rigid alignment of the bent maps of a building."""
    target, source, _ = bent_maps(kind, bend_m)
    return align_whole(target, source)


@cache
def found_of(kind: str, bend_m: float = 0.6) -> Alignment:
    """Return the alignment of the bent maps of a building, one of which may be deformed."""
    target, source, _ = bent_maps(kind, bend_m)
    return align(target, source)


def errors(motion: SE2, true: SE2, one: TbmMap) -> tuple[float, float]:
    """Return the error of a transform at the middle of a map [m], [rad]."""
    middle = np.array([np.mean(one.grid.geometry.bounds()[i::2]) for i in range(2)])
    apart = np.hypot(*(motion.apply(middle) - true.apply(middle)))
    return float(apart), abs((true.inverse() @ motion).theta)
