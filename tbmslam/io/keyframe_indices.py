"""Which poses of a trajectory keyframes are, for maps from before that was saved with them."""

from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory

_SAME_POSE = 1e-6
"""Poses that differ by less [m, rad] are one, written twice."""

_MOST_COMPARED = 100
"""Poses of one stamp that are compared with a keyframe: where a clock stands still, all poses have the same."""


def indices_by_stamp(trajectory: Trajectory, stamps: FloatArray, poses: FloatArray) -> npt.NDArray[np.int64]:
    """Return the index (K,) of each keyframe in the trajectory, in the order of the drive as stamps may step back.

    A keyframe is the next pose after the keyframe before it that has its stamp. Where several have it, it is the first
    of them that lies where the keyframe does; where none does, the first. Where none has its stamp, it is the pose at
    which stamps come nearest to it before they move away again. Without a trajectory keyframes are merely counted.

    Parameters
    ----------
    trajectory
        All poses (N, 3) of the drive and their stamps.
    stamps, poses
        Stamps (K,) [s] and poses (K, 3) of the keyframes, in the order of the drive.

    Raises
    ------
    ValueError
        If there are more keyframes than poses.
    """
    count, length = len(stamps), len(trajectory)
    if not length:
        return np.arange(count)
    if count > length:
        raise ValueError(f"{count} keyframes cannot be among the {length} poses of the trajectory")
    having: dict[float, list[int]] = {}
    for index, stamp in enumerate(trajectory.stamps.tolist()):
        having.setdefault(stamp, []).append(index)
    found, previous = np.empty(count, dtype=np.int64), -1
    for number, stamp in enumerate(stamps.tolist()):
        last = length - count + number  # so many come after it
        same = having.get(stamp, [])
        first = bisect_left(same, previous + 1)
        coming = [index for index in same[first : first + _MOST_COMPARED] if index <= last]
        if coming:
            apart = np.abs(trajectory.poses[coming] - poses[number]).max(axis=1)
            previous = coming[int(np.argmax(apart < _SAME_POSE))]  # the first one where there is none
        else:
            previous = _nearest_coming(trajectory.stamps, stamp, previous + 1, last)
        found[number] = previous
    return found


def _nearest_coming(stamps: FloatArray, stamp: float, first: int, last: int) -> int:
    """Return the first index from one to another, both included, after which stamps move away from the given one."""
    while first < last and abs(stamps[first + 1] - stamp) < abs(stamps[first] - stamp):
        first += 1
    return first
