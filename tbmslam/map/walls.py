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
    classify_walls,
    compare_walls,
    see_through_walls,
)

__all__ = ["AGREED", "COMPARED", "CONFLICTING", "SQUARES", "UNSEEN", "XX", "XY", "YY", "Walls"]
__all__ += ["AGREES", "CONFLICTS", "NEITHER", "NOT_SEEN", "OUTSIDE", "compare", "hold", "see_through", "slide"]

Indices = npt.NDArray[np.int64]


def compare(moving: Walls, some: Indices, fixed: Walls, motions: list[SE2], limits: Limits) -> FloatArray:
    """Return weighted sums (M, 8) over some walls (K,) of one map, compared with another map.

    Parameters
    ----------
    moving, fixed
        The map whose walls are compared, and the map with which they are compared.
    some
        Indices of the compared walls of the moving map.
    motions
        T_fixed_moving, as many as wanted.
    limits
        The thresholds of agreement and contradiction.

    Returns
    -------
    Columns COMPARED, AGREED, CONFLICTING, UNSEEN, the scatter XX, XY, YY of the agreeing walls' normals, and SQUARES of
    their distances [m^2], all counted in weights of walls.
    """
    return compare_walls(moving, some, fixed, np.array(motions, dtype=np.float64).reshape(-1, 3), limits)


def hold(moving: Walls, some: Indices, fixed: Walls, T_fixed_moving: SE2, limits: Limits) -> npt.NDArray[np.uint8]:
    """Return the class of each wall (K,) of one map under a transform to another map's frame.

    Returns
    -------
    OUTSIDE what the fixed map knows, or one of AGREES, CONFLICTS, NEITHER and NOT_SEEN, as `compare` counts them.
    """
    return classify_walls(moving, some, fixed, T_fixed_moving, limits)


def see_through(moving: Walls, fixed: Walls, T_fixed_moving: SE2, reach_m: float) -> npt.NDArray[np.bool_]:
    """Return which walls (N,) of one map another map saw through: it has free space up to a distance on both sides."""
    return see_through_walls(moving, fixed, T_fixed_moving, reach_m)


def slide(
    target: Walls,
    target_some: Indices,
    source: Walls,
    source_some: Indices,
    motions: list[SE2],
    reaches: FloatArray,
    facing: float,
) -> list[SE2]:
    """Slide walls onto walls point to line, in both directions, from first guesses (Chen and Medioni 1992; Censi 2008).

    Only walls that face the same way are matched. The weight decreases with the distance (Geman-McClure), so that moved
    or distorted walls have little influence.

    Parameters
    ----------
    target_some, source_some
        Indices of the walls that are matched.
    motions
        First guesses of T_target_source.
    reaches
        Largest distance of a match in each iteration [m].
    facing
        Least cosine between the normals of walls that may be one.
    """
    start = np.array(motions, dtype=np.float64).reshape(-1, 3)
    slid = slide_walls(target, target_some, source, source_some, start, reaches, facing)
    return [SE2.from_array(motion) for motion in slid]
