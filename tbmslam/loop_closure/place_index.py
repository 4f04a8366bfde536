"""Places by what they look like: found again however far a drive drifted, and in whatever frame they are."""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.search.place_signatures import FACINGS, pair_signature, spread_points
from tbmslam.sensing.laser_scan import Hits

_CELL = 0.4
"""Hits nearer to each other than about this count once, however often they were seen [m]."""

_MOST = 220
"""Hits that are compared with each other; the cost grows with the square."""

_WIDTH, _BINS = 1.0, 24  # of distances [m]

_CERTAINTY = 20.0
"""Log-likelihood of a place for each unit of similarity."""


def place_signature(hits: Hits) -> FloatArray:
    """Return what identifies a place by its hits: a vector (B,) that does not depend on their frame."""
    chosen = spread_points(hits.points, _CELL, _MOST)
    return pair_signature(hits.points[chosen], hits.normals[chosen], _WIDTH, _BINS)


class PlaceIndex:
    """Signatures of places, numbered as they come."""

    def __init__(self) -> None:
        self._count = 0
        self._signatures = np.zeros((64, _BINS * FACINGS))

    def __len__(self) -> int:
        """Return the number of places."""
        return self._count

    def add(self, signature: FloatArray) -> None:
        """Add a place."""
        if self._count == len(self._signatures):
            self._signatures = np.concatenate((self._signatures, np.zeros_like(self._signatures)))
        self._signatures[self._count] = signature
        self._count += 1

    def likeliest(self, signature: FloatArray, log_prior: FloatArray, count: int) -> npt.NDArray[np.int64]:
        """Return up to `count` places that a signature is most likely from, the likeliest first.

        Parameters
        ----------
        signature
            What is looked for.
        log_prior
            What is known otherwise of each place (P,), of the first ones at least; -inf leaves a place out.
        """
        known = len(log_prior)
        log_likelihoods = log_prior + _CERTAINTY * (self._signatures[:known] @ signature)
        order = np.argsort(-log_likelihoods, kind="stable")[:count]
        return np.asarray(order[np.isfinite(log_likelihoods[order])], dtype=np.int64)
