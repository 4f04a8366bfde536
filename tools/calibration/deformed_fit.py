"""Fits the confidence of deformed maps. The data are attempts to deform one map of a pair with a known pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from merging.config import MergeConfig
from merging.nonrigid.deformed_model import DeformedModel, DeformedTests
from merging.nonrigid.search import attempt, deformable, may_be_deformed
from merging.registration.features import Features
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution
from merging.walls import without_walls
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import FloatArray
from tools.map_pairs.known_pair import KnownPair

LEAST_CONFIDENCE = 0.4
"""Least confidence of the tests of an attempt that is used. Few false attempts pass the usual limit."""
_PENALTY = 0.001
"""Penalty on the squared weights but the bias."""


class TooFewPairsError(TbmSlamError):
    """There are too few pairs for a fit."""


@dataclass(frozen=True)
class DeformedTrial:
    """An attempt to deform a map, and the truth."""

    tests: DeformedTests
    right: bool
    weight: float = 1.0


def trial_of(pair: KnownPair, weight: float = 1.0) -> DeformedTrial | None:
    """Return the attempt at a pair that is refused without deformation; None if there is none."""
    config = MergeConfig.model_validate({"verification": {"min_confidence": LEAST_CONFIDENCE}})
    resolution = comparison_resolution([pair.target.grid, pair.source.grid], config)
    target, source = (deformable(one.grid, resolution, config) for one in (pair.target, pair.source))
    if target is None or source is None or without_walls(target.structure, source.structure):
        return None
    turned = target.structure.wall_m < source.structure.wall_m  # as in the registration
    fixed, moving = (source, target) if turned else (target, source)
    maps = [PreparedMap(one.structure, Features.none()) for one in (fixed, moving)]
    rigid = align_prepared(maps[0], maps[1], MergeConfig())
    if not may_be_deformed(rigid, config):
        return None
    found = attempt(fixed, moving, rigid, config)
    if found is None:
        return None
    motion = found.deformed.motion.inverse() if turned else found.deformed.motion
    return DeformedTrial(found.tests, pair.is_near(motion), weight)


def fit_deformed(trials: Sequence[DeformedTrial]) -> DeformedModel:
    """Return the model of maximum likelihood with a small quadratic penalty on its weights."""
    if not trials:
        raise TooFewPairsError("no map was deformed: try more pairs")
    features = np.array([trial.tests.features for trial in trials])
    signs = np.array([1.0 if trial.right else -1.0 for trial in trials])
    counts = np.array([trial.weight for trial in trials])
    penalised = np.array([0.0, 1.0, 1.0]) * _PENALTY

    def loss(weights: FloatArray) -> tuple[float, FloatArray]:
        wrong = np.logaddexp(0.0, -signs * (features @ weights))
        slope = -(counts * signs * (1.0 - np.exp(-wrong))) @ features
        return float(counts @ wrong + penalised @ weights**2), slope + 2.0 * penalised * weights

    found = optimize.minimize(loss, np.zeros(features.shape[1]), jac=True, method="BFGS").x
    return DeformedModel(*map(float, found))
