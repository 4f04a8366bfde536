"""The likelihood of walls that are seen through, at a true and at a false pose of two groups of maps.

A map lacks some stretches of wall, so a pair of maps may see through a little wall at its true pose
(`merging.scoring`). The merged map of a group contains nearly all walls. So at a true pose hardly any wall is seen
through. Stretches that are seen through are modelled as a Poisson process along the compared wall, with exponential
lengths. Their total length s on L metres of wall has the density of a compound Poisson distribution (W. Feller, "An
Introduction to Probability Theory and Its Applications", vol. 2, II.4)::

    P(s = 0) = exp(-r L),    p(s) = exp(-r L - s / m) sqrt(r L / (m s)) I1(2 sqrt(r L s / m))

with r stretches per metre of a mean length m, and the modified Bessel function I1. As in `Evidence`, s and L are means
of both directions of the comparison.

The prior is the confidence of the alignment of the merged maps. It uses s too, so part of this evidence is counted
twice: a logistic regression on 242 true and 1097 false pairs of groups gives the log ratio a quarter of the weight of
the prior's log odds. A ratio in favour of a pose counts half, which refuses fewer true poses than a quarter. A ratio
against it counts fully: a false merge is worse than a map that is left out.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ive

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.fusion import at_resolution
from merging.rigid_alignment import comparison_resolution
from merging.verification import Evidence, examine_all
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.tbm_map import TbmMap

_LENGTH_M = 0.35
"""Mean length of a stretch [m]: 0.48 m at true poses of groups of real maps, 0.34 and 0.32 m at false poses of groups
of real and simulated maps."""
_NOTHING_M = 0.03
"""Shorter lengths count as zero: a cell of 5 cm, seen through in one direction."""
_IN_FAVOUR, _MOST = 0.5, math.log(1000.0)
"""Weight of a log ratio in favour of a pose, and its largest weighted value: 1300 pairs of groups do not support more.
With the weight 1, two more of 700 simulated sets of six maps are merged to a group of two places."""
_SURE = 0.999
"""Largest prior probability."""
_LEAST = 1e-6
"""Least prior probability of a pose."""


class Stretches(NamedTuple):
    """Stretches of wall that are seen through."""

    per_m: float
    """Mean number on a metre of compared wall [1/m]."""

    def log_density(self, seen_through_m: float, compared_m: float) -> float:
        """Return the log of the density of a total length on a length of compared wall."""
        expected = self.per_m * max(compared_m, _LEAST)
        if seen_through_m < _NOTHING_M:
            return -expected
        root = math.sqrt(expected * seen_through_m / _LENGTH_M)
        bessel = math.log(ive(1, 2.0 * root)) + 2.0 * root
        return -expected - seen_through_m / _LENGTH_M + math.log(root / seen_through_m) + bessel


AT_TRUE_POSES = Stretches(0.001)
"""Fitted to 36 pairs of groups of real maps (mit-csail, aces, intel). On 212 pairs of groups of simulated maps it is
0.0008."""
AT_FALSE_POSES = Stretches(0.11)
"""Fitted to the best poses of 193 pairs of groups of simulated maps of different buildings, those with a confidence
above 0.01. On 30 pairs of groups of real maps it is 0.16."""


def weighted_log_ratio(evidence: Evidence) -> float:
    """Return the log of how much likelier the walls seen through are at a true pose than at a false one, weighted."""
    found = evidence.seen_through_m, evidence.compared_wall_m
    ratio = AT_TRUE_POSES.log_density(*found) - AT_FALSE_POSES.log_density(*found)
    return min(_IN_FAVOUR * ratio, _MOST) if ratio > 0.0 else ratio


def confidences_of_groups(found: Alignment, target: TbmMap, source: TbmMap, config: MergeConfig) -> FloatArray:
    """Return the probabilities (K,) of the hypotheses of an alignment of two groups, each as one map."""
    hypotheses = found.hypotheses()
    prior = np.array([hypothesis.confidence for hypothesis in hypotheses])
    if found.evidence is None:
        return prior
    others = _examined(target, source, [hypothesis.T_target_source for hypothesis in found.alternatives], config)
    ratios = np.array([weighted_log_ratio(each) for each in (found.evidence, *others)])
    none = max(1.0 - float(prior.sum()), 1.0 - _SURE)
    logits = np.append(np.log(np.maximum(prior, _LEAST)) + ratios, math.log(none))
    shares = np.exp(logits - logits.max())
    return np.asarray(shares[:-1] / shares.sum())


def _examined(target: TbmMap, source: TbmMap, motions: list[SE2], config: MergeConfig) -> list[Evidence]:
    if not motions:
        return []
    resolution = comparison_resolution([target.grid, source.grid], config)
    fixed, moving = (
        WallMap.from_grid(at_resolution(tbm_map.grid, resolution), config.structure) for tbm_map in (target, source)
    )
    return examine_all(fixed, moving, motions, config.verification)
