"""Where the source may lie: every place that the walls speak for, made exact, and what each has to say for itself."""

import numpy as np

from merging.config import MergeConfig
from merging.registration.correlation import Proposals, distinct, propose
from merging.verification.evidence import Evidence, examine_all, support_m
from merging.walls import WallMap, without_walls
from tbmslam.geometry.se2 import SE2, FloatArray, compose
from tbmslam.kernels.grids.walls import FACING
from tbmslam.map.walls import slide

_ELSEWHERE_M, _ELSEWHERE_RAD = 1.0, 0.15
"""Alignments farther apart than this are different answers, not one answer twice."""

_LEAST_SCORE_M = 1.0
"""So little wall agrees anywhere by chance [m]."""

Candidate = tuple[SE2, Evidence]
"""A motion T_target_source and what the maps say about it."""


def find_candidates(target: WallMap, source: WallMap, config: MergeConfig) -> list[Candidate]:
    """Return the places that the walls speak for most, the best first, none near a better one.

    The correlation proposes many motions on coarse cells; a few hundred walls slide and some more judge all of
    them, and all walls the best.
    """
    return best_of(propose(target, source, config.correlation).motions, target, source, config)


def best_of(proposals: list[SE2], target: WallMap, source: WallMap, config: MergeConfig) -> list[Candidate]:
    """Make proposals exact; return those that the walls speak for most, the best first, none near a better one.

    Where a map has no walls, none speak for any.
    """
    if not proposals or without_walls(target, source):
        return []
    how = config.refinement
    some = target.some(how.few_walls), source.some(how.few_walls)
    rough = np.geomspace(how.proposal_reach_m, how.first_reach_m / 2.0, how.rough_iterations)
    slid = slide(target.walls, some[0], source.walls, some[1], proposals, rough, FACING)
    supports = support_m(target, source, slid, config.verification, how.some_walls)
    best = elsewhere(slid, supports, source, config.correlation.semifinalists)
    finalists = refine_all(target, source, best, config)
    supports = support_m(target, source, finalists, config.verification, how.many_walls)
    finalists = elsewhere(finalists, supports, source, config.correlation.finalists)
    return list(zip(finalists, examine_all(target, source, finalists, config.verification), strict=True))


def refine_all(target: WallMap, source: WallMap, motions: list[SE2], config: MergeConfig) -> list[SE2]:
    """Make alignments exact."""
    how = config.refinement
    reaches = np.geomspace(how.first_reach_m, how.last_reach_m, how.iterations)
    some = target.some(how.many_walls), source.some(how.many_walls)
    return slide(target.walls, some[0], source.walls, some[1], motions, reaches, FACING)


def lead_of(proposals: Proposals, source: WallMap) -> float:
    """Return the score of the best of some proposals over that of the best one elsewhere; 0 where there is none."""
    if not proposals.motions:
        return 0.0
    best = {motion: float(score) for motion, score in zip(*proposals, strict=True)}
    scores = [best[motion] for motion in elsewhere(proposals.motions, proposals.scores, source, 2)]
    return max(scores[0], 0.0) / max(*scores[1:], _LEAST_SCORE_M)


def elsewhere(motions: list[SE2], scores: FloatArray, source: WallMap, count: int) -> list[SE2]:
    """Return so many of the best motions, none of which puts the source where a better one puts it already."""
    centroid = np.append(source.centroid, 0.0)
    centres = compose(np.array(motions, dtype=np.float64).reshape(-1, 3), centroid)
    return [motions[index] for index in distinct(centres, scores, _ELSEWHERE_M, _ELSEWHERE_RAD, count)]
