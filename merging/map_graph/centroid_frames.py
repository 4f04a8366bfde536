"""Frames at the centroids of maps.

Where a frame has its origin says nothing: that of a plan may lie in another town. What maps say of each other is
compared at places they know, since a tenth of a degree is metres at a kilometre.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from merging.map_graph.hypothesis import PoseHypothesis
from merging.verification.covariance import known_best_at, seen_from
from tbmslam.geometry.se2 import SE2


class CentroidFrames:
    """Where the centroids of maps lie in their frames, by what their alignments are about.

    Parameters
    ----------
    offers
        Of pairs of maps, in the frames that the maps have. A map of which none tells keeps its frame.
    """

    def __init__(self, offers: Sequence[PoseHypothesis]) -> None:
        about: dict[str, list[tuple[float, float]]] = {}
        for offer in offers:
            if offer.covariance is not None:
                point = known_best_at(offer.covariance)
                x, y = offer.motion.apply(point)
                about.setdefault(offer.pair[0], []).append((float(x), float(y)))
                about.setdefault(offer.pair[1], []).append(point)
        centroids = {name: np.mean(points, axis=0) for name, points in about.items()}
        self._middles = {name: SE2(float(x), float(y), 0.0) for name, (x, y) in centroids.items()}

    def of(self, name: str) -> SE2:
        """Return the pose of a map's middle in its frame: T_map_middle."""
        return self._middles.get(name, SE2.identity())

    def between(self, offer: PoseHypothesis) -> PoseHypothesis:
        """Return where an offer puts the middle of its source in the frame at the middle of its target."""
        target, source = (self.of(name) for name in offer.pair)
        seen = None if offer.covariance is None else seen_from(offer.covariance, source.inverse())
        return replace(offer, motion=target.inverse() @ offer.motion @ source, covariance=seen)

    def group(self, poses: Mapping[str, SE2]) -> tuple[SE2, dict[str, SE2]]:
        """Return the pose of the first map's middle in a group's frame, and all maps' centroids as seen from there."""
        centroids = {name: pose @ self.of(name) for name, pose in poses.items()}
        first = next(iter(centroids.values()))
        return first, {name: first.inverse() @ pose for name, pose in centroids.items()}

    def maps(self, poses: Mapping[str, SE2]) -> dict[str, SE2]:
        """Return where the maps of a group lie in the first one's frame, of where their centroids lie in any."""
        in_first = {name: pose @ self.of(name).inverse() for name, pose in poses.items()}
        first = next(iter(in_first.values())).inverse()
        return {name: first @ pose for name, pose in in_first.items()}
