"""Comparison of walls: agreement under a motion, and the motion refined until most walls agree."""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.wall_sliding import slide_walls
from tbmslam.kernels.grids.walls import (
    AGREED,
    AGREES,
    COMPARED,
    CONFLICTING,
    CONFLICTS,
    NEITHER,
    NOT_SEEN,
    OUTSIDE,
    SQUARES,
    UNSEEN,
    XX,
    XY,
    YY,
    Limits,
    Walls,
    compare_walls,
)
from tbmslam.kernels.grids.walls import classify_walls as classify
from tbmslam.kernels.grids.walls import see_through_walls as see_through

__all__ = ["AGREED", "COMPARED", "CONFLICTING", "SQUARES", "UNSEEN", "XX", "XY", "YY", "Walls"]
__all__ += ["AGREES", "CONFLICTS", "NEITHER", "NOT_SEEN", "OUTSIDE", "classify", "compare", "see_through", "slide"]

Indices = npt.NDArray[np.int64]


def compare(moving: Walls, some: Indices, fixed: Walls, motions: list[SE2], limits: Limits) -> FloatArray:
    """Return weighted sums (M, 8) over some moving walls (K,) for motions T_fixed_moving, see `compare_walls`.

    The columns are COMPARED, AGREED, CONFLICTING, UNSEEN, the scatter XX, XY, YY of the normals of agreeing walls, and
    SQUARES of their distances [m^2].
    """
    return compare_walls(moving, some, fixed, np.array(motions, dtype=np.float64).reshape(-1, 3), limits)


def slide(
    target: Walls,
    target_some: Indices,
    source: Walls,
    source_some: Indices,
    motions: list[SE2],
    reaches: FloatArray,
    facing: float,
) -> list[SE2]:
    """Refine motions T_target_source by point-to-line ICP in both directions (Chen and Medioni 1992; Censi 2008).

    Each reach is the largest distance of a match in one iteration [m]. Only walls with similar normals match, with a
    cosine of at least `facing`. The weight decreases with the distance (Geman-McClure), so that moved or distorted
    walls have little influence.
    """
    start = np.array(motions, dtype=np.float64).reshape(-1, 3)
    slid = slide_walls(target, target_some, source, source_some, start, reaches, facing)
    return [SE2.from_array(motion) for motion in slid]
