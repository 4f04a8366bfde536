"""The likelihood of walls that are seen through, at a true and at a false pose of two groups of maps.

One map lacks some stretches of wall, so a pair of maps may see through a little wall at its true pose
(`merging.scoring`). The merged map of a group hardly lacks any. Then stretches seen through are a Poisson process along
the compared wall, with exponential lengths. Their total length s on L metres of wall has the density of a compound
Poisson distribution (W. Feller, "An Introduction to Probability Theory and Its Applications", vol. 2, II.4)::

    P(s = 0) = exp(-r L),    p(s) = exp(-r L - s / m) sqrt(r L / (m s)) I1(2 sqrt(r L s / m))

with r stretches per metre of a mean length m, and the modified Bessel function I1.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ive

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.rigid_alignment import comparison_resolution, prepared
from merging.verification import Evidence, examine
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.tbm_map import TbmMap


class Stretches(NamedTuple):
    """Stretches of wall that are seen through."""

    per_m: float
    """Mean number on a metre of compared wall [1/m]."""
    length_m: float
    """Mean length beyond a door leaf [m]."""

    def log_density(self, seen_through_m: float, compared_m: float) -> float:
        """Return the log of the density of a total length on a length of compared wall."""
        expected = self.per_m * max(compared_m, _NOTHING_M)
        if seen_through_m < _NOTHING_M:
            return -expected
        root = math.sqrt(expected * seen_through_m / self.length_m)
        bessel = math.log(ive(1, 2.0 * root)) + 2.0 * root
        return -expected - seen_through_m / self.length_m + math.log(root / seen_through_m) + bessel


AT_TRUE_POSES = Stretches(0.001, 0.4)
"""Fitted to 36 pairs of groups of real maps at their true poses (mit-csail, aces, intel). On 212 pairs of groups of
simulated maps it is 0.0016 and 0.17 m."""
AT_FALSE_POSES = Stretches(0.12, 0.32)
"""Fitted to the best poses of 193 pairs of groups of simulated maps of different buildings, those with a confidence
above 0.01. On 30 pairs of groups of real maps it is 0.17 and 0.34 m."""
_NOTHING_M = 0.025
"""A shorter length is half a cell, no stretch."""
_LEAST = 1e-6
"""Least prior probability."""


def log_likelihood_ratio(evidence: Evidence) -> float:
    """Return the log of how much likelier the walls seen through are at a true pose than at a false one."""
    found = evidence.seen_through_m, evidence.compared_wall_m
    return AT_TRUE_POSES.log_density(*found) - AT_FALSE_POSES.log_density(*found)


def confidences_of_groups(found: Alignment, target: TbmMap, source: TbmMap, config: MergeConfig) -> FloatArray:
    """Return the probabilities (K,) of the hypotheses of an alignment of two groups, each as one map.

    They are the confidences of two single maps, updated by the walls that are seen through.
    """
    hypotheses = found.hypotheses()
    prior = np.array([hypothesis.confidence for hypothesis in hypotheses])
    others = _examined(target, source, [hypothesis.T_target_source for hypothesis in hypotheses[1:]], config)
    ratios = np.array([log_likelihood_ratio(each) for each in (found.evidence, *others) if each is not None])
    if len(ratios) < len(prior):
        return prior
    none = max(1.0 - float(prior.sum()), _LEAST)
    logits = np.append(np.log(np.maximum(prior, _LEAST)) + ratios, math.log(none))
    shares = np.exp(logits - logits.max())
    return np.asarray(shares[:-1] / shares.sum())


def _examined(target: TbmMap, source: TbmMap, motions: list[SE2], config: MergeConfig) -> list[Evidence]:
    if not motions:
        return []
    resolution = comparison_resolution([target.grid, source.grid], config)
    fixed, moving = (prepared(tbm_map.grid, resolution, config) for tbm_map in (target, source))
    if fixed is None or moving is None:
        return []
    return [examine(fixed.structure, moving.structure, motion, config.verification) for motion in motions]
