"""The rigid motion that most of the matches agree on."""

from dataclasses import dataclass

import numpy as np

from merging.config.registration import ConsensusConfig
from merging.registration.features import Matches
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Consensus:
    """A motion and the matches that support it."""

    T_target_source: SE2
    """The rigid motion with the least squared distance over the inliers."""
    inliers: BoolArray
    """Whether each match (M,) is an inlier."""
    rmse_m: float
    """Root mean square distance of the inliers after the motion [m]."""
    scale: float
    """The factor that would fit the inliers best if the motion could stretch; 1 for two maps in metres."""

    @property
    def count(self) -> int:
        """The number of inliers."""
        return int(self.inliers.sum())


def find_consensus(matches: Matches, config: ConsensusConfig) -> Consensus | None:
    """Find the similarity that most matches agree on, and the rigid motion that fits them best.

    Every pair of matches proposes a motion, or a drawn sample of the pairs if there are many. The motion with the least
    sum of squared distances, each limited to the inlier distance, is chosen (MSAC, Torr and Zisserman 2000). Motions
    with a scale are tried only if too few matches agree on a rigid motion. They show that maps have different scales.
    Returns None if no two matches are far enough apart.
    """
    pairs = _pairs(matches, config)
    if len(pairs) == 0:
        return None
    rigid = _best(matches, pairs, config, stretching=False)
    if rigid is not None and rigid.count >= config.min_inliers:
        return rigid
    stretched = _best(matches, pairs, config, stretching=True)
    # A free scale makes agreement by chance more likely.
    if stretched is not None and stretched.count >= 2 * config.min_inliers:
        return stretched
    return rigid


def _pairs(matches: Matches, config: ConsensusConfig) -> IntArray:
    """Return pairs (K, 2) of matches that lie far enough apart in both maps."""
    count = len(matches)
    first, second = np.triu_indices(count, k=1)
    if len(first) > config.trials:
        rng = np.random.default_rng(config.seed)
        drawn = np.sort(rng.choice(len(first), size=config.trials, replace=False))
        first, second = first[drawn], second[drawn]
    apart = np.minimum(
        np.linalg.norm(matches.target_points[first] - matches.target_points[second], axis=1),
        np.linalg.norm(matches.source_points[first] - matches.source_points[second], axis=1),
    )
    return np.asarray(np.column_stack((first, second))[apart >= config.min_baseline_m])


def _best(matches: Matches, pairs: IntArray, config: ConsensusConfig, *, stretching: bool) -> Consensus | None:
    """Return the consensus of the pair whose proposal fits all matches best."""
    target = matches.target_points @ [1.0, 1.0j]  # a motion of the plane is a product and a sum of complex numbers
    source = matches.source_points @ [1.0, 1.0j]
    first, second = pairs.T
    factors = (target[second] - target[first]) / (source[second] - source[first])
    if not stretching:
        # Both points may be off by the inlier distance; a motion that stretches their line more is not rigid.
        slack = 2.0 * config.inlier_distance_m / np.abs(source[second] - source[first])
        rigid = np.abs(np.abs(factors) - 1.0) <= slack
        first, second, factors = first[rigid], second[rigid], factors[rigid] / np.abs(factors[rigid])
    if len(factors) == 0:
        return None
    shifts = (target[first] + target[second] - factors * (source[first] + source[second])) / 2.0
    limit = config.inlier_distance_m**2
    costs = np.concatenate(
        [
            np.minimum(np.abs(f[:, None] * source + s[:, None] - target) ** 2, limit).sum(axis=1)
            for f, s in zip(np.array_split(factors, 16), np.array_split(shifts, 16), strict=True)
        ]
    )
    best = int(np.argmin(costs))
    inliers = np.abs(factors[best] * source + shifts[best] - target) <= config.inlier_distance_m
    return _refined(matches, inliers, config) if not stretching else _measured(matches, inliers)


def _refined(matches: Matches, inliers: BoolArray, config: ConsensusConfig) -> Consensus:
    """Fit all inliers instead of two, and let the fit choose its inliers anew until it stays as it is."""
    for _ in range(10):
        motion, _ = fit_rigid(matches.target_points[inliers], matches.source_points[inliers])
        chosen = _distances(matches, motion) <= config.inlier_distance_m
        if chosen.sum() < inliers.sum() or np.array_equal(chosen, inliers):
            break
        inliers = chosen
    return _measured(matches, inliers)


def _measured(matches: Matches, inliers: BoolArray) -> Consensus:
    motion, scale = fit_rigid(matches.target_points[inliers], matches.source_points[inliers])
    rmse_m = float(np.sqrt(np.mean(_distances(matches, motion)[inliers] ** 2)))
    return Consensus(motion, inliers, rmse_m, scale)


def _distances(matches: Matches, T_target_source: SE2) -> FloatArray:
    moved = T_target_source.apply(matches.source_points)
    return np.asarray(np.linalg.norm(moved - matches.target_points, axis=1))
