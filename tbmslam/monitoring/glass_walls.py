"""Walls of glass beside the way: a laser meets them square to them only, and sees through them elsewhere.

Straight ahead that is like a part of the robot at its side. Where the robot turns a little, the part turns with it, and
the spot on the glass stays square to the wall.
"""

import math

import numpy as np

from tbmslam.se2 import FloatArray

_SQUARE = math.radians(10.0)  # spots are so wide, or no way is straighter
_ASIDE = math.radians(15.0)  # no spot wanders farther on a way straight ahead
_SURE = 3.0  # logarithm of the odds
_LEAST = 0.004  # no direction of a spot is known better [rad]


def is_square_to_way(bearings: FloatArray, lasers: FloatArray) -> bool:
    """Tell whether any of some bearings (N,) [rad] is square to the way along poses (K, 3), seen from the last."""
    way = lasers[-1, :2] - lasers[0, :2]
    heading = math.atan2(way[1], way[0]) - lasers[-1, 2]
    return bool((np.abs(np.cos(bearings - heading)) < math.sin(_SQUARE)).any())


def turns_along(begin: int, end: int, lasers: FloatArray, seen: FloatArray, farthest: float, step: float) -> int:
    """Tell whether what beams from `begin` to `end` see turns with the robot: 1, or does not: -1, or nothing tells: 0.

    Parameters
    ----------
    lasers, seen
        Poses (K, 3) of the laser and ranges (K, B) of its scans [m].
    farthest
        How far the beams end [m].
    step
        Between beams [rad].
    """
    aside = math.ceil(_ASIDE / abs(step))
    first = max(begin - aside, 0)
    near = seen[:, first : end + aside] <= farthest
    some = near.any(axis=1)
    if some.sum() < 3:
        return 0
    index = np.arange(near.shape[1])
    bearing = (near[some] @ index) / near[some].sum(axis=1) * step
    heading = np.unwrap(lasers[some, 2])
    with_robot, with_world = (float(np.var(values)) for values in (bearing, bearing + heading))
    variance = max(min(with_robot, with_world), _LEAST**2)
    odds = 0.5 * int(some.sum()) * (with_world - with_robot) / variance
    return int(odds > _SURE) - int(odds < -_SURE)
