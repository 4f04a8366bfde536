"""Search for revisited places beyond the usual window: places are compared by signatures that need no common frame."""

import math

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, IntArray
from tbmslam.kernels.search.place_signatures import FACINGS, pair_signature, spread_points
from tbmslam.loop_closure.candidates import ChainDrift, ClosingTargets
from tbmslam.map.scan_hits import DriveHits
from tbmslam.optimisation.pose_graph import relative_pose
from tbmslam.sensing.laser_scan import Hits

_CELL = 0.4
"""Side of the cells to which hits are thinned [m]."""

_MOST = 220
"""Number of hits that are compared pairwise; the cost grows with its square."""

_WIDTH, _BINS = 1.0, 24  # of distances [m]

_CERTAINTY = 20.0
"""Log-likelihood of a place for each unit of similarity."""


def place_signature(hits: Hits) -> FloatArray:
    """Return the signature (B,) of a place by its hits; it does not depend on their frame."""
    chosen = spread_points(hits.points, _CELL, _MOST)
    return pair_signature(hits.points[chosen], hits.normals[chosen], _WIDTH, _BINS)


class PlaceIndex:
    """The signatures of places, in the order of their addition."""

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

    def likeliest(self, signature: FloatArray, log_prior: FloatArray, count: int) -> IntArray:
        """Return up to `count` most likely places of a signature, the likeliest first.

        `log_prior` (P,) is the log-probability of the first places without the signature; -inf excludes a place.
        """
        known = len(log_prior)
        log_likelihoods = log_prior + _CERTAINTY * (self._signatures[:known] @ signature)
        order = np.argsort(-log_likelihoods, kind="stable")[:count]
        return np.asarray(order[np.isfinite(log_likelihoods[order])], dtype=np.int64)


_DEVIATIONS = 3.0
"""Number of standard deviations of the drift within which a place is possible."""

_LIKELIEST = 12
"""Number of likeliest places that are searched; more hardly find further true ones."""

_CLOSELY = 6
"""Number of best poses in them that are refined."""

_ALONE = 10.0
"""Least path since the last registration to a place; before, the pose is accurate [m]."""


class FarSearch:
    """Proposes poses of a keyframe in targets beyond its window, the likeliest ones by their signatures.

    The window is the largest distance of the usual search from the current pose [m], and `reach` the largest distance
    of a keyframe from the path of a target [m].
    """

    def __init__(
        self, hits: DriveHits, targets: ClosingTargets, drift: ChainDrift, window: float, reach: float
    ) -> None:
        self._hits, self._targets, self._drift = hits, targets, drift
        self._window, self._reach = window, reach
        self._index = PlaceIndex()

    def possible(self, keyframe: int, poses: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the log-likelihoods (T,) of a keyframe being at old targets by its drift, and turns (T,) [rad].

        None if the drift allows no place beyond the window.
        """
        if self._hits.travelled[keyframe] - self._targets.last_met < _ALONE:
            return None
        _, latest = self._targets.anchors(keyframe)
        if not len(latest) or _DEVIATIONS * self._drift.largest_deviation(latest.min(), keyframe) <= self._window:
            return None
        log_prior, turns = self._by_drift(keyframe, poses)
        return (log_prior, turns) if np.isfinite(log_prior).any() else None

    def places(
        self,
        keyframe: int,
        poses: FloatArray,
        bundle: Hits,
        search_points: int,
        possible: tuple[FloatArray, FloatArray],
    ) -> list[tuple[int, SE2]]:
        """Return targets and poses in them at which a keyframe's bundle may lie, the best first."""
        log_prior, turns = possible
        while len(self._index) < len(log_prior):
            self._index.add(place_signature(self._hits_of(len(self._index))))
        points = bundle.thinned(search_points).points
        found = []
        for target in self._index.likeliest(place_signature(bundle), log_prior, _LIKELIEST).tolist():
            submap = self._targets.submap(target)
            guess = SE2(0.0, 0.0, relative_pose(poses, submap.anchor, keyframe).theta)
            shift = 0.5 * self._targets.length + self._reach
            found += [
                (score, target, pose) for score, pose in submap.rough_places(points, guess, shift, turns[target], 2)
            ]
        found.sort(key=lambda one: -one[0])
        return [(target, pose) for _, target, pose in found[:_CLOSELY]]

    def _by_drift(self, keyframe: int, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log-likelihoods and turns of `possible`; -inf for places that the drift rules out."""
        anchors, latest = self._targets.anchors(keyframe)
        here = np.full(len(anchors), keyframe)
        positions, headings = self._drift.deviations(latest, here)
        away = np.maximum(np.hypot(*(poses[anchors, :2] - poses[keyframe, :2]).T) - 0.5 * self._targets.length, 0.0)
        beyond = np.maximum(away - self._reach, 0.0)
        possible = (beyond <= _DEVIATIONS * positions) & (_DEVIATIONS * positions > self._window)
        log_prior = np.where(possible, -0.5 * (beyond / np.maximum(positions, 1e-9)) ** 2, -math.inf)
        return log_prior, _DEVIATIONS * headings

    def _hits_of(self, target: int) -> Hits:
        """Return hits of some keyframes of a target."""
        first, last = self._targets.stretch(target)
        chosen: IntArray = np.arange(first, last + 1, max((last - first) // 16, 1))
        return self._hits.placed(chosen, (first + last) // 2, 3000)
