"""Knots along drives, which bend as these move."""

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.kernels.adjustment.two_levels import Bends

_APART = 8
"""Poses between knots: farther apart they leave more to be done pose by pose, and nearer they cost more themselves."""
_MOST_KNOTS = 250


def bends_of(ends: Sequence[int]) -> Bends:
    """Return knots for drives whose poses come one drive after the other.

    Parameters
    ----------
    ends
        Where each drive begins, and where the last one ends (D + 1,); each has a pose at least.
    """
    apart = max(_APART, -(-ends[-1] // _MOST_KNOTS))
    knots, sides, shares = list[npt.NDArray[np.int64]](), list[npt.NDArray[np.int64]](), list[npt.NDArray[np.float64]]()
    count = 0
    for first, last in itertools.pairwise(ends):
        own = np.round(np.linspace(first, last - 1, -(-(last - 1 - first) // apart) + 1)).astype(np.int64)
        poses = np.arange(first, last)
        before = np.clip(np.searchsorted(own, poses, side="right") - 1, 0, max(len(own) - 2, 0))
        after = np.minimum(before + 1, len(own) - 1)
        share = (poses - own[before]) / np.maximum(own[after] - own[before], 1)
        knots.append(own)
        sides.append(count + np.column_stack((before, after)))
        shares.append(np.column_stack((1.0 - share, share)))
        count += len(own)
    return Bends(np.concatenate(knots), np.vstack(sides), np.vstack(shares))
