"""The evidence for the poses of one map pair with known truth, and its judgement by a confidence model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from merging.config import MergeConfig
from merging.nonrigid.deformation import DeformableMap
from merging.nonrigid.hypotheses import DeformedPoses
from merging.nonrigid.rivals import DeformedRivals, first_distinct
from merging.registration.correlation import find_candidates
from merging.rigid_alignment import prepared
from merging.scoring import ConfidenceModel, features, find_decoys, measured
from merging.verification import Evidence
from merging.walls import WallMap, without_walls
from tbmslam.geometry.se2 import BoolArray, FloatArray
from tools.map_pairs.known_pair import KnownPair


@dataclass(frozen=True)
class Judgement:
    """The best pose of a pair by a model."""

    name: str
    confidence: float
    """Confidence of the most probable pose; 0 without a pose."""
    right: bool
    """Whether this pose is the true one."""


@dataclass(frozen=True)
class Trial:
    """The evidence for the poses of one pair, and the truth."""

    name: str
    candidates: Sequence[Evidence]
    decoys: Sequence[Evidence]
    """Evidence for each candidate pose (K,), and for poses of the mirror image."""
    right: BoolArray
    """Whether each candidate (K,) is right."""
    near: BoolArray
    """Whether each candidate (K,) is near the true pose, with a larger tolerance of rotation. The model is fitted to
    these, since it distinguishes places and not the accuracy of their poses."""
    weight: float = 1.0
    """Weight of the pair in the fit."""

    @classmethod
    def of(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Search the candidate poses of a pair; None if one of its maps is empty."""
        target, source = (
            prepared(item.grid, item.grid.geometry.resolution, config) for item in (pair.target, pair.source)
        )
        if target is None or source is None:
            return None
        turned = source.structure.wall_m > target.structure.wall_m  # as in the alignment
        staying, moving = (source, target) if turned else (target, source)
        found = find_candidates(staying.structure, moving.structure, config)
        decoys = find_decoys(staying.structure, moving.structure, config)
        motions = [motion.inverse() if turned else motion for motion, _ in found]
        right, near = (np.array([of(motion) for motion in motions], np.bool_) for of in (pair.is_right, pair.is_near))
        return cls(pair.name, [evidence for _, evidence in found], decoys, right, near, weight)

    @classmethod
    def of_deformed(cls, pair: KnownPair, config: MergeConfig, weight: float = 1.0) -> "Trial | None":
        """Deform one map of a pair at its most likely pose and at the rivals; None if it fits nowhere."""
        structures = [WallMap.from_grid(item.grid, config.structure) for item in (pair.target, pair.source)]
        if not all(item.grid.is_known().any() for item in (pair.target, pair.source)) or without_walls(*structures):
            return None
        moving = 0 if structures[0].wall_m < structures[1].wall_m else 1  # as in the alignment
        target, grid = structures[1 - moving], (pair.target, pair.source)[moving].grid
        source = DeformableMap.of(grid, config, structures[moving])
        poses = DeformedPoses(target, source, config)
        likeliest = poses.likeliest(first_distinct(poses.proposals, source.structure, config.nonrigid.places), ())
        if likeliest is None:
            return None
        rivals = DeformedRivals.of(poses, likeliest)
        near = np.array([pair.is_near(pose if moving == 1 else pose.inverse()) for pose in rivals.motions], np.bool_)
        return cls(pair.name, rivals.evidence, rivals.decoys, near, near, weight)

    def judged(self, model: ConfidenceModel) -> Judgement:
        """Return the best pose by a model."""
        p = model.probabilities(self.candidates, self.decoys)
        if len(p) == 0:
            return Judgement(self.name, 0.0, right=False)
        return Judgement(self.name, float(p.max()), bool(self.right[int(p.argmax())]))

    @cached_property
    def numbers(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Features (K, F) and measures (K, M) of the candidates, and measures (D, M) of the decoys."""
        return features(self.candidates, self.decoys), measured(self.candidates), measured(self.decoys)
