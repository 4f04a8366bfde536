"""What the scans of a drive hit, made once for all that go over it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.kernels.rays.hits import hits_of_scans
from tbmslam.map.keyframes import Keyframes


@dataclass(frozen=True, eq=False)
class ScanHits:
    """The hits of keyframes, each in its sensor's frame, wherever that is: to a micrometre, in half the memory.

    Parameters
    ----------
    points, normals
        Hits (P, 2) [m] of one scan after the other, and the normals (P, 2) of what was hit, towards the laser.
    offsets
        Where each scan's begin, and where the last ones end (K + 1,).
    """

    points: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    offsets: npt.NDArray[np.int64]

    @classmethod
    def of(cls, keyframes: Keyframes, max_range: float) -> "ScanHits":
        """Return the hits of keyframes up to a range [m]."""
        return cls(
            *hits_of_scans(keyframes.ranges, keyframes.offsets, keyframes.beams, keyframes.beam_steps, max_range)
        )

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self.offsets) - 1
