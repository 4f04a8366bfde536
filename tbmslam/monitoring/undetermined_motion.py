"""Where neither odometry nor scans determine the motion of the robot, so that the map there is a guess.

Without odometry the robot is taken to go on as before. A scan corrects that guess by a share in each direction: the
eigenvalues of (H + P)^-1 H, the gain of a Kalman filter, with the informations H of the scan and P of the guess. Where
the smallest share is below a half, as along bare walls or where the laser sees nothing, the guess outweighs the scan.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels import BoolArray
from tbmslam.monitoring.incidents import EndWarning
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe

_LEAST_S = 2.0
"""A robot that goes on as before for less than this errs by centimetres."""
_LEAST_SHARE = 0.1
"""Of a drive, above which all of it is told at once instead of each moment."""


class UndeterminedMotion(NamedTuple):
    """What of a drive is a guess.

    Parameters
    ----------
    share
        Share of the drive's time, in [0, 1].
    spells
        Begin and end (S, 2) of each time that is long enough to be told [s].
    """

    share: float
    spells: FloatArray

    def warnings(self) -> list[EndWarning]:
        """Return what is said of it: each moment, or once of the whole drive where it is much of it."""
        if self.share > _LEAST_SHARE:
            return [EndWarning("motion", f"for {self.share:.0%} of the drive {_UNDETERMINED}")]
        return [
            EndWarning("motion", _UNDETERMINED, begin, end - begin, all_along=False)
            for begin, end in self.spells.tolist()
        ]


_UNDETERMINED = (
    "neither odometry nor scans determine the motion: the map is a guess there; record odometry, or use a laser that "
    "sees farther"
)


def undetermined_motion(keyframes: Sequence[TrackedKeyframe]) -> UndeterminedMotion:
    """Return where the motion of a drive is not determined, by its keyframes as the surfel tracker left them."""
    stamps = np.array([keyframe.outline.stamp for keyframe in keyframes])
    guessed = _guessed(keyframes)
    lasted = np.maximum(np.diff(stamps), 0.0)  # a clock may step back
    whole = float(lasted.sum())
    share = float(lasted[guessed].sum()) / whole if whole > 0.0 else 0.0
    edges = np.diff(np.concatenate(([False], guessed, [False])).astype(np.int64))
    spells = np.column_stack((stamps[np.flatnonzero(edges == 1)], stamps[np.flatnonzero(edges == -1)]))
    return UndeterminedMotion(share, spells[spells[:, 1] - spells[:, 0] >= _LEAST_S])


def _guessed(keyframes: Sequence[TrackedKeyframe]) -> BoolArray:
    """Return which steps (K - 1,) between keyframes, to the latter of both, are rather guessed than determined."""
    without = np.array([keyframe.T_odom_robot is None for keyframe in keyframes], dtype=np.bool_)
    later = keyframes[1:]
    if not without.any():
        return np.zeros(len(later), dtype=np.bool_)
    unknown = np.zeros((3, 3))
    if all(keyframe.match.information is None for keyframe in later) and any(
        keyframe.match.moved for keyframe in later
    ):
        return np.zeros(len(later), dtype=np.bool_)  # a matcher that does not say
    seen = np.array([unknown if k.match.information is None else k.match.information for k in later]).reshape(-1, 3, 3)
    guess = np.array([keyframe.prior for keyframe in later]).reshape(-1, 3, 3)
    root = np.linalg.inv(np.linalg.cholesky(guess))
    gains = np.linalg.eigvalsh(root @ seen @ np.swapaxes(root, 1, 2))[:, 0]  # of the scan over the guess
    guessed: BoolArray = (gains < 1.0) & (without[1:] | without[:-1])
    return guessed
