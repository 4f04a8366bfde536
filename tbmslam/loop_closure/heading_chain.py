"""A chain of turns, and how far the sum of its errors at loop closures is from that of independent errors."""

from collections.abc import Sequence

import numpy as np

from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge

_PRIOR_LOOPS = 0.1
"""The stated variances count as much as this number of loops. Without it, a single loop that closes by chance would
make the headings of a whole drive certain."""
_MOST_CLOSURES = 300
"""Number of closures that are compared with each other; a long drive has many thousand."""


class HeadingChain:
    """Turns (S,) from keyframe to keyframe [rad], and their variances (S,) [rad^2]; inf for an unknown turn."""

    def __init__(self, turns: FloatArray, variances: FloatArray) -> None:
        known = np.isfinite(variances)
        self._headings = _summed(np.where(known, turns, 0.0))
        self._expected = _summed(np.where(known, variances, 0.0))
        self._unknown = _summed(np.where(known, 0.0, 1.0))

    def drift(self, closures: Sequence[MotionEdge]) -> float:
        """Return the ratio of the squared heading errors at closures to their expectation from independent turns.

        1 if no closure spans known turns. A closure cannot show errors below its own noise, which is counted as an
        error. A false closure of a short loop makes the ratio large. Closures that share turns err alike: together they
        count as few independent loops, by Satterthwaite's degrees of freedom of a sum of squares (1946).
        """
        chosen = np.unique(np.linspace(0, len(closures) - 1, min(len(closures), _MOST_CLOSURES)).astype(np.int64))
        ends, motions, informations = EdgeArrays.of([closures[number] for number in chosen.tolist()])
        first, last = np.sort(ends, axis=1).T
        begins, stops = self._expected[first], self._expected[last]
        usable = (self._unknown[first] == self._unknown[last]) & (begins < stops)
        if not usable.any():
            return 1.0
        measured = np.where(ends[:, 0] < ends[:, 1], motions[:, 2], -motions[:, 2])
        noise = np.linalg.inv(informations)[:, 2, 2]
        squares = wrap_angles(self._headings[last] - self._headings[first] - measured) ** 2 + noise
        begins, stops = begins[usable], stops[usable]
        in_common = np.minimum(stops[:, None], stops) - np.maximum(begins[:, None], begins)
        expected = float((stops - begins).sum())
        loops = expected**2 / float((np.maximum(in_common, 0.0) ** 2).sum())
        return (_PRIOR_LOOPS + loops * float(squares[usable].sum()) / expected) / (_PRIOR_LOOPS + loops)


def _summed(values: FloatArray) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(values)))
