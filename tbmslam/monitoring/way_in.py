"""The way on which a robot came: whether a wall stands on it by now, as where a door was shut behind it."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import SE2, FloatArray
from tbmslam.tracking.seen_space import small_things

_ON_WAY = 0.15  # what stands nearer to the robot's way than this stands where it drove [m]
_CLEAR = 0.6  # of where it is, as it may turn there [m]
_FEWEST = 3  # hits
_TOGETHER = 0.3  # neighbours farther from each other are on two things [m]


def is_shut(way: Sequence[SE2], scan: LaserScan, T_map_sensor: SE2, T_map_robot: SE2, reach: float) -> bool:
    """Tell whether a scan hits what is larger than people on the way of the robot.

    Parameters
    ----------
    way
        Where the robot was before, the last last.
    scan, T_map_sensor, T_map_robot
        What is seen now, and from where.
    reach
        Hits beyond this are not looked at [m].
    """
    places = np.array([(pose.x, pose.y) for pose in way]).reshape(-1, 2)
    begins, steps = places[:-1], np.diff(places, axis=0)
    behind = np.hypot(begins[:, 0] - T_map_robot.x, begins[:, 1] - T_map_robot.y) > _CLEAR
    hits = scan.hit_points()
    if not behind.any() or not len(hits):
        return False
    begins, steps = begins[behind], steps[behind]
    placed, ends = T_map_sensor.apply(hits), np.vstack((begins, begins + steps))
    low, high = ends.min(axis=0) - _ON_WAY, ends.max(axis=0) + _ON_WAY
    on_way = ((placed > low) & (placed < high)).all(axis=1) & (np.hypot(hits[:, 0], hits[:, 1]) <= reach)
    on_way[on_way] = (_distances(placed[on_way], begins, steps) < _ON_WAY).any(axis=1)
    if int(on_way.sum()) < _FEWEST:
        return False
    standing = on_way & ~small_things(hits)  # which takes longer than all else
    # A wall along which the robot drove is as near to its way, but does not cross it.
    return int(standing.sum()) >= _FEWEST and _are_crossed(begins, steps, placed, standing)


def _are_crossed(begins: FloatArray, steps: FloatArray, placed: FloatArray, those: npt.NDArray[np.bool_]) -> bool:
    """Tell whether what stands between neighbours (M, 2), either of them one of those, crosses a segment (K, 2)."""
    walls = np.roll(placed, -1, axis=0) - placed  # the last and the first of a full turn, too
    (between,) = np.nonzero((those | np.roll(those, -1)) & (np.hypot(walls[:, 0], walls[:, 1]) < _TOGETHER))
    rest, walls = placed[between, None] - begins, walls[between, None]
    first, last = _area(walls, rest), _area(walls, rest - steps)
    # Two on either side, as a single wrong beam goes over and comes back.
    sides = [_area(steps, placed[(between + k) % len(placed), None] - begins) >= 0.0 for k in (-1, 0, 1, 2)]
    crossed = (sides[0] == sides[1]) & (sides[1] != sides[2]) & (sides[2] == sides[3])
    return bool((crossed & (first * last <= 0.0)).any())


def _area(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the area between vectors (..., 2), negative where the second one lies to the right."""
    area: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return area


def _distances(points: FloatArray, begins: FloatArray, steps: FloatArray) -> FloatArray:
    """Return how far points (M, 2) are from segments, begins and steps (K, 2), as (M, K) [m]."""
    rest = points[:, None] - begins
    along = np.sum(rest * steps, axis=2) / np.maximum(np.sum(steps**2, axis=1), 1e-9)
    distances: FloatArray = np.linalg.norm(rest - along.clip(0.0, 1.0)[:, :, None] * steps, axis=2)
    return distances
