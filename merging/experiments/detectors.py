"""Brute-force matching of descriptors, for any ratio of Lowe's test."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast

import cv2
import numpy as np
import numpy.typing as npt

from merging.experiments.map_pair import MapPair
from merging.registration.features import ORB_EDGE, Channels, Image
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class Described:
    """Points (N, 2) [m] of a map and their descriptors (N, D)."""

    points: FloatArray
    descriptors: npt.NDArray[np.generic]


@dataclass(frozen=True)
class DescriptorMatches:
    """The nearest descriptor of each descriptor, and the ratio of the distances."""

    target_points: FloatArray
    source_points: FloatArray
    """Points (M, 2) of each match [m]."""
    ratios: FloatArray
    """Distance (M,) of the nearest over that of the second nearest."""

    def clearer_than(self, ratio: float) -> "DescriptorMatches":
        """Return the matches that pass Lowe's test."""
        kept = self.ratios < ratio
        return DescriptorMatches(self.target_points[kept], self.source_points[kept], self.ratios[kept])

    def share_right(self, pair: MapPair, tolerance_m: float) -> float:
        """Return the share of right matches, xi in the paper; nan without matches."""
        if len(self.ratios) == 0:
            return float("nan")
        return float(pair.is_right(self.target_points, self.source_points, tolerance_m).mean())


def match_all(target: Described, source: Described, norm: int = cv2.NORM_HAMMING) -> DescriptorMatches:
    """Match each descriptor of the source to the nearest of the target, which must have at least two."""
    if len(target.points) < 2 or len(source.points) == 0:
        return DescriptorMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    nearest = cv2.BFMatcher(norm).knnMatch(np.asarray(source.descriptors), np.asarray(target.descriptors), k=2)
    first = np.array([best.distance for best, _ in nearest])
    second = np.array([other.distance for _, other in nearest])
    # Two descriptors at equal distances, even at 0, are ambiguous.
    ratios = np.divide(first, second, out=np.ones_like(first), where=second > 0.0)
    return DescriptorMatches(
        target.points[[best.trainIdx for best, _ in nearest]],
        source.points[[best.queryIdx for best, _ in nearest]],
        ratios,
    )


RANSAC_PIXELS = 3.0
"""Largest distance of an inlier in the paper's program [px]; OpenCV's default."""


class _Detector(Protocol):
    def detectAndCompute(
        self, image: Image, mask: None
    ) -> tuple[Sequence[cv2.KeyPoint], npt.NDArray[np.generic] | None]: ...


@dataclass(frozen=True)
class Detector:
    """A kind of keypoint."""

    create: Callable[[int], object]
    """Function that returns OpenCV's detector, sensitive enough for the requested number of keypoints."""
    norm: int
    """Norm of the distance between descriptors."""


class _Brief:
    """BRIEF descriptors (Calonder 2010) of STAR keypoints, since BRIEF has no detector."""

    def __init__(self, contributed: Any) -> None:
        self._detector = contributed.StarDetector.create(responseThreshold=1)
        self._extractor = contributed.BriefDescriptorExtractor.create()

    def detectAndCompute(
        self, image: Image, mask: None
    ) -> tuple[Sequence[cv2.KeyPoint], npt.NDArray[np.generic] | None]:
        found: tuple[Sequence[cv2.KeyPoint], npt.NDArray[np.generic] | None]
        found = self._extractor.compute(image, self._detector.detect(image, mask))
        return found


def contributed_detectors() -> dict[str, Detector]:
    """Return SURF and BRIEF if the installed OpenCV has them, from its contrib package.

    SURF is there only where that was built with what was patented.
    """
    contributed: Any = getattr(cv2, "xfeatures2d", None)
    if contributed is None or not hasattr(contributed, "BriefDescriptorExtractor"):
        return {}
    found = {"BRIEF": Detector(lambda _: _Brief(contributed), cv2.NORM_HAMMING)}
    try:
        contributed.SURF.create()
    except (AttributeError, cv2.error):
        return found
    return {"SURF": Detector(lambda _: contributed.SURF.create(hessianThreshold=10), cv2.NORM_L2), **found}


DETECTORS: Mapping[str, Detector] = {
    "ORB": Detector(lambda count: cv2.ORB.create(nfeatures=count), cv2.NORM_HAMMING),
    "BRISK": Detector(lambda _: cv2.BRISK.create(thresh=10), cv2.NORM_HAMMING),
    "SIFT": Detector(lambda count: cv2.SIFT.create(nfeatures=count), cv2.NORM_L2),
    "AKAZE": Detector(lambda _: cv2.AKAZE.create(threshold=1e-5), cv2.NORM_HAMMING),
    **contributed_detectors(),
}


@dataclass(frozen=True)
class DetectorResult:
    """The result of a detector on a pair."""

    matches: int
    """Matches that passed Lowe's test."""
    share_right: float
    """Share of matches that are right by the true pose; nan without matches."""
    share_inliers: float
    """Share of inliers of an affine transform by RANSAC, without the truth; nan without a transform."""


def compare_detectors(pair: MapPair, keypoints: int, ratio: float, tolerance_m: float) -> dict[str, DetectorResult]:
    """Match a pair by each detector, with about the given number of keypoints in each map."""
    results = {}
    for name, detector in DETECTORS.items():
        target, source = (_described(grid, detector, keypoints) for grid in (pair.target, pair.source))
        matches = match_all(target, source, detector.norm).clearer_than(ratio)
        results[name] = DetectorResult(
            len(matches.ratios),
            matches.share_right(pair, tolerance_m),
            share_of_inliers(matches, RANSAC_PIXELS * pair.target.geometry.resolution),
        )
    return results


def share_of_inliers(matches: DescriptorMatches, threshold_m: float) -> float:
    """Return the share of matches within a distance [m] of the affine transform that RANSAC finds; nan for none."""
    if len(matches.ratios) < 3:
        return float("nan")
    matrix, inliers = cv2.estimateAffine2D(
        matches.source_points, matches.target_points, ransacReprojThreshold=threshold_m
    )
    return float("nan") if matrix is None else float(np.asarray(inliers).mean())


def _described(grid: TbmGrid, detector: Detector, count: int) -> Described:
    """Find the strongest keypoints; BRISK and AKAZE have no parameter for their number."""
    channels = Channels.from_grid(grid, border=ORB_EDGE + 1)
    keypoints, descriptors = cast("_Detector", detector.create(count)).detectAndCompute(channels.pignistic, None)
    if descriptors is None or not len(keypoints):
        return Described(np.empty((0, 2)), np.empty((0, 1), dtype=np.uint8))
    strength = np.array([keypoint.response for keypoint in keypoints])
    strongest = np.sort(np.argsort(-strength, kind="stable")[:count])
    return Described(channels.to_metres([keypoints[index].pt for index in strongest]), descriptors[strongest])
