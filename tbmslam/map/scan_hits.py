"""The hits of the scans of a drive, computed once for all uses."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray, IntArray, path_lengths
from tbmslam.kernels.rays.hits import hits_of_scans, place_hits
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import Hits

_ALL = 1 << 62


@dataclass(frozen=True, eq=False)
class ScanHits:
    """The hits of keyframes, each in its sensor's frame, where single precision is exact to a micrometre."""

    points: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    """Hits (P, 2) [m] of all scans in their order, and normals (P, 2) of the surfaces, towards the laser."""
    offsets: npt.NDArray[np.int64]
    """Begin of each scan's hits, and end of the last scan's hits (K + 1,)."""

    @classmethod
    def of(cls, keyframes: Keyframes, max_range: float) -> "ScanHits":
        """Return the hits of keyframes up to a range [m]."""
        return cls(
            *hits_of_scans(keyframes.ranges, keyframes.offsets, keyframes.beams, keyframes.beam_steps, max_range)
        )

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self.offsets) - 1


class DriveHits:
    """The hits of all keyframes of a drive and their poses (K, 3) as tracked: x [m], y [m], theta [rad].

    `travelled` (K,) is the length of the path to each keyframe [m]. The step to a keyframe of `breaks` counts as
    `break_length` more [m], so that hits before and after it are not joined.
    """

    def __init__(
        self, scans: ScanHits, poses: FloatArray, breaks: IntArray | None = None, break_length: float = 0.0
    ) -> None:
        if len(scans) != len(poses):
            raise ValueError(f"scans must be as many as poses, got {len(scans)} and {len(poses)}")
        self.scans, self.poses = scans, poses
        self.travelled = path_lengths(poses)
        for keyframe in () if breaks is None else breaks:
            self.travelled[keyframe:] += break_length
        self._travelled = self.travelled.tolist()

    def stops(self, step: float) -> list[int]:
        """Return keyframes about `step` metres apart."""
        _, first = np.unique((self.travelled / step).astype(np.int64), return_index=True)
        return [int(keyframe) for keyframe in first]

    def begins(self, chosen: npt.NDArray[np.int64], at_least: int = _ALL) -> npt.NDArray[np.int64]:
        """Return the begins of the hits of some keyframes in the result of `placed`, and the end of the last.

        Parameters are those of `placed`.
        """
        counts = self.scans.offsets[chosen + 1] - self.scans.offsets[chosen]
        ends = np.concatenate(([0], np.cumsum(counts)))
        return -(-ends // max(int(ends[-1]) // at_least, 1))

    def placed(self, chosen: npt.NDArray[np.int64], frame: int, at_least: int = _ALL) -> Hits:
        """Return the hits of some keyframes in the frame of a keyframe.

        Only every n-th hit is returned, with n = size // at_least, so that at least `at_least` of as many remain; by
        default all.
        """
        scans = self.scans
        return Hits(*place_hits(scans.points, scans.normals, scans.offsets, chosen, self.poses, frame, at_least))

    def bundle(self, keyframe: int, reach: float, at_least: int) -> Hits:
        """Return hits of a keyframe and some within a travelled length before and after, in its frame."""
        here = self._travelled[keyframe]
        first, stop = bisect_left(self._travelled, here - reach), bisect_left(self._travelled, here + reach + 1e-9)
        chosen = np.array([keyframe, *range(first, stop, max((stop - first) // 8, 1))])
        return self.placed(chosen, keyframe, at_least)
