"""What a scan's score asks of a cell, and how much each beam counts in it."""

from functools import lru_cache
from typing import Literal

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.sensing.laser_scan import LaserScan

BeamWeighting = Literal["even", "viny"]
CellScore = Literal["discrepancy", "disjunctive"]
"""vinySLAM's discrepancy to a certain hit, or the consistency of the credibilist SLAM: what the disjunctive rule leaves
on OCCUPIED (Trehard et al., "Credibilist simultaneous localization and mapping with a lidar", IROS 2014)."""


def beam_weights(scan: LaserScan, weighting: BeamWeighting) -> FloatArray:
    """Return the weight (M,) of every hit beam, adding up to one.

    ``even`` treats all alike. ``viny`` is vinySLAM's: beams along and across the sensor's axis, which meet the walls of
    a corridor end-on, count up to three times, and all by the square root of their range.
    """
    hit = scan.is_hit()
    if not hit.any():
        return np.zeros(0)
    if weighting == "even":
        weights = np.ones(int(hit.sum()))
    else:
        turning = scan.angle_increment + scan.beam_step.theta
        weights = _say_of_directions(len(hit), scan.angle_min, turning)[hit] * np.sqrt(scan.ranges[hit])
    return np.asarray(weights / weights.sum())


@lru_cache(maxsize=8)
def _say_of_directions(count: int, first: float, step: float) -> FloatArray:
    """Return how much each of some directions (N,) counts; a laser's are always the same."""
    angles = first + step * np.arange(count, dtype=np.float64)
    cosine, sine = np.abs(np.cos(angles)), np.abs(np.sin(angles))
    return np.asarray(np.select([cosine > 0.9, cosine > 0.8], [3.0, 2.0], sine + cosine))
