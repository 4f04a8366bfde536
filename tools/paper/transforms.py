"""Table III: the accuracy of the transforms. Table IV: the running time."""

import time
from dataclasses import dataclass

import numpy as np
from scipy import stats

from merging.config import MergeConfig
from merging.config.registration import FeatureConfig
from merging.fusion import fuse, place
from merging.merger import align
from merging.registration.features import describe_all, match
from merging.registration.ransac import find_consensus
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.tbm_map import TbmMap
from tools.paper.detectors import RANSAC_PIXELS, affine_of
from tools.paper.map_pair import MapPair


@dataclass(frozen=True)
class TransformResult:
    """The transforms of a pair."""

    matches: int
    right: int
    """Number of matches that pass Lowe's test, and number of right matches."""
    least_m: float | None
    most_m: float | None
    geometric_mean_m: float | None
    """Distances of all matches after the affine transform, as in the paper [m]; None without a transform."""
    affine_error_m: float | None
    """Mean true error of the source's cells under the transform [m]."""
    rigid_error_m: float | None
    """Mean true error under the rigid motion of most matches [m]."""
    default_error_m: float | None
    """Mean true error of the default method, which uses no keypoints [m]; None if it refuses."""


def measure_transforms(pair: MapPair, config: MergeConfig, tolerance_m: float) -> TransformResult:
    """Align a pair by the method of the paper's program, by the rigid consensus, and by the default method."""
    features = describe_all([pair.target, pair.source], config.features)
    matches = match(features[0], features[1], config.features)
    target, source = matches.target_points, matches.source_points
    affine, _ = affine_of(target, source, RANSAC_PIXELS * pair.target.geometry.resolution)
    apart = None if affine is None else np.hypot(*(source @ affine[:, :2].T + affine[:, 2] - target).T)
    consensus = find_consensus(matches, config.consensus)
    found = align(TbmMap(pair.target), TbmMap(pair.source), MergeConfig())
    return TransformResult(
        matches=len(matches),
        right=int(pair.is_right(target, source, tolerance_m).sum()),
        least_m=None if apart is None else float(apart.min()),
        most_m=None if apart is None else float(apart.max()),
        geometric_mean_m=None if apart is None else float(stats.gmean(apart)),
        affine_error_m=None if affine is None else pair.displacement_m(affine),
        rigid_error_m=None if consensus is None else pair.displacement_m(consensus.T_target_source.matrix()[:2]),
        default_error_m=pair.displacement_m(found.T_target_source.matrix()[:2])
        if found.accepted and found.T_target_source is not None
        else None,
    )


@dataclass(frozen=True)
class DurationResult:
    """Times of a pair."""

    area_m2: float
    """Area of the rectangle around the merged map, as in the paper [m^2]."""
    milliseconds: FloatArray
    """Wall time (R,) of each run [ms]."""


def measure_durations(pair: MapPair, repeats: int, features: FeatureConfig) -> DurationResult:
    """Time the paper's algorithm 1: keypoints, descriptors, matching, transform, and disjunctive fusion at the truth.

    A first run is not counted. If the keypoints find no transform, or a wrong one, the maps are fused at the true one,
    so that every run has the same work.
    """
    config = MergeConfig(features=features)
    taken = np.empty(repeats + 1)
    area_m2 = 0.0
    for run in range(repeats + 1):
        begin = time.perf_counter()
        described = describe_all([pair.target, pair.source], config.features)
        find_consensus(match(described[0], described[1], config.features), config.consensus)
        fused = fuse([pair.target, place(pair.source, pair.T_target_source, pair.target.geometry)]).grid.geometry
        taken[run] = 1e3 * (time.perf_counter() - begin)
        area_m2 = fused.rows * fused.cols * fused.resolution**2
    return DurationResult(area_m2, taken[1:])
