"""The way on which a robot came: whether a wall stands on it by now, as where a door was shut behind it."""

from collections.abc import Sequence

import numpy as np

from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import SE2, FloatArray
from tbmslam.tracking.seen_space import small_things

_ON_WAY = 0.15  # what stands nearer to the robot's way than this stands where it drove [m]
_CLEAR = 0.6  # of where it is, as it may turn there [m]
_FEWEST = 3  # hits


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
    # Looking for small things takes longer than all else.
    return int(on_way.sum()) >= _FEWEST and int(np.count_nonzero(on_way & ~small_things(hits))) >= _FEWEST


def _distances(points: FloatArray, begins: FloatArray, steps: FloatArray) -> FloatArray:
    """Return how far points (M, 2) are from segments, begins and steps (K, 2), as (M, K) [m]."""
    rest = points[:, None] - begins
    along = np.sum(rest * steps, axis=2) / np.maximum(np.sum(steps**2, axis=1), 1e-9)
    distances: FloatArray = np.linalg.norm(rest - along.clip(0.0, 1.0)[:, :, None] * steps, axis=2)
    return distances
