"""Tables I and II, and figure 3: detectors and descriptors, matched by brute force."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, cast

import cv2
import numpy as np
import numpy.typing as npt

from merging.config.registration import Descriptor, FeatureConfig
from merging.registration.features import ORB_EDGE, Channels, Image, joined, orb_of
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import BoolArray, FloatArray
from tools.paper.map_pair import MapPair


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


DETECTORS: Mapping[str, Detector] = {
    "ORB": Detector(lambda count: cv2.ORB.create(nfeatures=count), cv2.NORM_HAMMING),
    "BRISK": Detector(lambda _: cv2.BRISK.create(thresh=10), cv2.NORM_HAMMING),
    "SIFT": Detector(lambda count: cv2.SIFT.create(nfeatures=count), cv2.NORM_L2),
    "AKAZE": Detector(lambda _: cv2.AKAZE.create(threshold=1e-5), cv2.NORM_HAMMING),
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
    matrix, inliers = affine_of(matches.target_points, matches.source_points, threshold_m)
    return float("nan") if matrix is None else float(inliers.mean())


def affine_of(target: FloatArray, source: FloatArray, threshold_m: float) -> tuple[FloatArray | None, BoolArray]:
    """Fit an affine transform to matches (M, 2) [m] like the paper's program, which uses OpenCV's defaults.

    Return the transform (2, 3), or None if there is none, and which matches (M,) are within the distance [m] of it.
    """
    if len(source) < 3:
        return None, np.zeros(len(source), dtype=np.bool_)
    matrix, inliers = cv2.estimateAffine2D(source, target, ransacReprojThreshold=threshold_m)
    found = None if matrix is None else np.asarray(matrix, dtype=np.float64)
    return found, np.asarray(inliers, dtype=np.bool_).ravel()


def _described(grid: TbmGrid, detector: Detector, count: int) -> Described:
    """Find the strongest keypoints; BRISK and AKAZE have no parameter for their number."""
    channels = Channels.from_grid(grid, border=ORB_EDGE + 1)
    keypoints, descriptors = cast("_Detector", detector.create(count)).detectAndCompute(channels.pignistic, None)
    if descriptors is None or not len(keypoints):
        return Described(np.empty((0, 2)), np.empty((0, 1), dtype=np.uint8))
    strength = np.array([keypoint.response for keypoint in keypoints])
    strongest = np.sort(np.argsort(-strength, kind="stable")[:count])
    return Described(channels.to_metres([keypoints[index].pt for index in strongest]), descriptors[strongest])


MODIFICATIONS: Mapping[str, Descriptor] = {"a": "pignistic", "b": "concatenated", "c": "and", "d": "or", "e": "xor"}
"""The paper's letters."""


class Variant(NamedTuple):
    """Differences between the paper and its program."""

    bits: Literal[128, 256]
    """Length of the descriptor of an image: 128 in the paper, which is the first half of the 256 of OpenCV's ORB."""
    unknown: Literal["as it is", "inverted"]
    """Whether the third image shows the unknown mass, as in the paper, or is inverted, as in its program."""


AS_WRITTEN = Variant(128, "as it is")
AS_PROGRAMMED = Variant(256, "inverted")


class Setting(NamedTuple):
    """A row and a column of table II."""

    keypoints: int
    ratio: float
    modification: str


@dataclass(frozen=True)
class Study:
    """The measurements."""

    shares: dict[Setting, FloatArray] = field(default_factory=dict)
    """For every setting the share of right matches in each pair (P,); nan if nothing matched."""
    matches: dict[Setting, npt.NDArray[np.int64]] = field(default_factory=dict)
    """For every setting the number of matches in each pair (P,)."""
    found: dict[int, npt.NDArray[np.int64]] = field(default_factory=dict)
    """Numbers of keypoints found in each map (2 P,), by the requested number."""


_Keypoints = tuple[FloatArray, dict[str, npt.NDArray[np.uint8]]]


def compare_modifications(
    pairs: Sequence[MapPair],
    keypoints: Sequence[int],
    ratios: Sequence[float],
    variants: Sequence[Variant],
    tolerance_m: float,
    say: Callable[[str], None] = lambda _: None,
) -> dict[Variant, Study]:
    """Match all pairs with all numbers of keypoints, modifications and ratios.

    `tolerance_m` is the largest distance of a right match from its true position [m].
    """
    studies = {variant: Study() for variant in variants}
    for count in keypoints:
        say(f"{count} keypoints")
        found_by_name: dict[str, _Keypoints] = {}
        for pair in pairs:
            for name, grid in ((pair.target_name, pair.target), (pair.source_name, pair.source)):
                if name not in found_by_name:
                    found_by_name[name] = _keypoints_of(grid, count)
        for variant, study in studies.items():
            shares, matches = _measured(pairs, found_by_name, variant, ratios, tolerance_m)
            for (ratio, letter), values in shares.items():
                setting = Setting(count, ratio, letter)
                study.shares[setting] = np.array(values)
                study.matches[setting] = np.array(matches[ratio, letter])
            sides = [len(found_by_name[name][0]) for pair in pairs for name in (pair.target_name, pair.source_name)]
            study.found[count] = np.array(sides)
    return studies


def _measured(
    pairs: Sequence[MapPair],
    found_by_name: Mapping[str, _Keypoints],
    variant: Variant,
    ratios: Sequence[float],
    tolerance_m: float,
) -> tuple[dict[tuple[float, str], list[float]], dict[tuple[float, str], list[int]]]:
    shares: dict[tuple[float, str], list[float]] = {(r, m): [] for r in ratios for m in MODIFICATIONS}
    counts: dict[tuple[float, str], list[int]] = {(r, m): [] for r in ratios for m in MODIFICATIONS}
    for pair in pairs:
        for letter, how in MODIFICATIONS.items():
            target, source = (
                _modified(found_by_name[name], how, variant) for name in (pair.target_name, pair.source_name)
            )
            everything = match_all(target, source)
            for ratio in ratios:
                kept = everything.clearer_than(ratio)
                shares[ratio, letter].append(kept.share_right(pair, tolerance_m))
                counts[ratio, letter].append(len(kept.ratios))
    return shares, counts


def _keypoints_of(grid: TbmGrid, count: int) -> _Keypoints:
    """Return the keypoints of a grid [m] and their descriptors in each image."""
    channels = Channels.from_grid(grid, border=ORB_EDGE + 1)
    images = {
        "pignistic": channels.pignistic,
        "occupied": channels.occupied,
        "free": channels.free,
        "as it is": channels.unknown,
        "inverted": np.asarray(255 - channels.unknown, dtype=np.uint8),
    }
    orb = orb_of(FeatureConfig(keypoints=count))
    keypoints = orb.detect(channels.pignistic, None)
    if not keypoints:
        return np.empty((0, 2)), {name: np.empty((0, 32), dtype=np.uint8) for name in images}
    described = {name: orb.compute(image, keypoints) for name, image in images.items()}
    points = channels.to_metres([keypoint.pt for keypoint in described["pignistic"][0]])
    return points, {name: np.asarray(found, dtype=np.uint8) for name, (_, found) in described.items()}


def _modified(keypoints: _Keypoints, how: Descriptor, variant: Variant) -> Described:
    points, found = keypoints
    names = ["pignistic"] if how == "pignistic" else ["occupied", "free", variant.unknown]
    # ORB's tests are sorted by their additional information: the first are the best (Rublee 2011).
    return Described(points, joined([found[name][:, : variant.bits // 8] for name in names], how))
