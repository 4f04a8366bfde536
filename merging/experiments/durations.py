"""Table IV: what a merge takes, by the area of the merged map."""

import time
from dataclasses import dataclass

import numpy as np

from merging.config import MergeConfig
from merging.config.registration import FeatureConfig
from merging.experiments.map_pair import MapPair
from merging.fusion.fusion import fuse
from merging.fusion.warping import place
from merging.registration.features import describe_all, match
from merging.registration.ransac import find_consensus
from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class DurationResult:
    """Times of one pair.

    Parameters
    ----------
    area_m2
        Of the rectangle around the merged map [m^2], as the paper counts.
    milliseconds
        Wall time (R,) of each run [ms].
    """

    area_m2: float
    milliseconds: FloatArray


def measure_durations(pair: MapPair, repeats: int, features: FeatureConfig | None = None) -> DurationResult:
    """Time the paper's algorithm 1: keypoints, descriptors, matching, transform, and disjunctive fusion at the truth.

    One run before is not counted. Where the keypoints find no transform, or a wrong one, the maps are fused at the true
    one, so that every run has the same work.
    """
    config = MergeConfig(features=features or FeatureConfig())
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
