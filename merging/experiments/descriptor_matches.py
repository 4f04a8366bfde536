"""Descriptors matched by brute force, with Lowe's ratio left open."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from merging.experiments.map_pair import MapPair
from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class Described:
    """Points (N, 2) [m] of a map and their descriptors (N, D)."""

    points: FloatArray
    descriptors: npt.NDArray[np.generic]


@dataclass(frozen=True)
class DescriptorMatches:
    """The nearest descriptor of every one, and how clear it is.

    Parameters
    ----------
    target_points, source_points
        Points (M, 2) of each match [m].
    ratios
        Distance (M,) of the nearest over that of the second nearest.
    """

    target_points: FloatArray
    source_points: FloatArray
    ratios: FloatArray

    def clearer_than(self, ratio: float) -> "DescriptorMatches":
        """Return the matches that pass Lowe's test."""
        kept = self.ratios < ratio
        return DescriptorMatches(self.target_points[kept], self.source_points[kept], self.ratios[kept])

    def share_right(self, pair: MapPair, tolerance_m: float) -> float:
        """Return the share of the matches that are right, the paper's xi; nan where there is none."""
        if len(self.ratios) == 0:
            return float("nan")
        return float(pair.is_right(self.target_points, self.source_points, tolerance_m).mean())


def match_all(target: Described, source: Described, norm: int = cv2.NORM_HAMMING) -> DescriptorMatches:
    """Match every descriptor of the source to its nearest of the target's, where the target has two or more."""
    if len(target.points) < 2 or len(source.points) == 0:
        return DescriptorMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    nearest = cv2.BFMatcher(norm).knnMatch(np.asarray(source.descriptors), np.asarray(target.descriptors), k=2)
    first = np.array([best.distance for best, _ in nearest])
    second = np.array([other.distance for _, other in nearest])
    # Two descriptors equally near, even both at no distance, are no clear match.
    ratios = np.divide(first, second, out=np.ones_like(first), where=second > 0.0)
    return DescriptorMatches(
        target.points[[best.trainIdx for best, _ in nearest]],
        source.points[[best.queryIdx for best, _ in nearest]],
        ratios,
    )
