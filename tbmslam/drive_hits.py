"""What a whole drive's keyframes hit, in one piece that kernels go over."""

from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from tbmslam.kernels.hits import hits_of_scans, place_hits
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import Hits
from tbmslam.se2 import SE2, FloatArray, way_lengths


class DriveHits:
    """The hits of all keyframes of a drive, each in its sensor's frame.

    Parameters
    ----------
    keyframes
        The scans; where they were taken is told by `poses`.
    poses
        Poses (K, 3) of the laser as tracked: x [m], y [m], theta [rad].
    max_range
        Hits beyond this are left out [m].

    Attributes
    ----------
    poses
        As given.
    travelled
        Length of the way up to each keyframe (K,) [m].
    """

    def __init__(self, keyframes: Keyframes, poses: FloatArray, max_range: float) -> None:
        if len(keyframes) != len(poses):
            raise ValueError(f"keyframes must be as many as poses, got {len(keyframes)} and {len(poses)}")
        self.poses = poses
        self.travelled = way_lengths(poses)
        self._way = self.travelled.tolist()
        # To a micrometre, in half the memory; made once, as it is most of what closing loops needs.
        self._points, self._normals, self._offsets = hits_of_scans(
            keyframes.ranges, keyframes.offsets, keyframes.beams, keyframes.beam_steps, max_range
        )

    def count(self, chosen: npt.NDArray[np.int64]) -> int:
        """Return how many hits some keyframes have."""
        return int((self._offsets[chosen + 1] - self._offsets[chosen]).sum())

    def begins(self, chosen: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return where the hits of each of some keyframes begin among all of theirs, and where the last ones end."""
        counts = self._offsets[chosen + 1] - self._offsets[chosen]
        return np.concatenate(([0], np.cumsum(counts)))

    def placed(self, chosen: npt.NDArray[np.int64], frame: int, at_least: int | None = None) -> Hits:
        """Return hits of some keyframes in the frame of one.

        Parameters
        ----------
        chosen
            Indices of the keyframes.
        frame
            Index of the one.
        at_least
            Every n-th hit is enough, as long as this many are left, where there are as many; None for all.
        """
        step = 1 if at_least is None else max(self.count(chosen) // at_least, 1)
        pose = SE2.from_array(self.poses[frame])
        return Hits(*place_hits(self._points, self._normals, self._offsets, chosen, self.poses, pose, step))

    def bundle(self, keyframe: int, reach: float, at_least: int) -> Hits:
        """Return hits of a keyframe and some within a travelled length before and after, in its frame."""
        here = self._way[keyframe]
        first, stop = bisect_left(self._way, here - reach), bisect_left(self._way, here + reach + 1e-9)
        chosen = np.array([keyframe, *range(first, stop, max((stop - first) // 8, 1))])
        return self.placed(chosen, keyframe, at_least)
