"""Poses of a map that is deformed at each pose, and their evidence.

The registration of tiles at many poses is fast. The deformation of the map and its comparison are slow, so they are
done only at the best supported poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from merging.config import MergeConfig
from merging.nonrigid.deformation import DeformableMap, DeformedMap, TileFit, deformed_by, fit_tiles
from merging.registration.correlation import best_distinct, propose, refine_all
from merging.scoring import confidences
from merging.verification import Evidence, examine, support_m
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2

_WORTH_COMPARING = 0.5
"""Least support of a pose that may be the most likely one, as a share of the best support."""
_COMPARED = 4
"""Number of best supported poses that are compared by all evidence. A confidence needs the hypothesis, its best rival
and the next one, which stands for chance."""


class DeformedPose(NamedTuple):
    """A pose of a map that was deformed there."""

    motion: SE2
    """T_target_source of the deformed map."""
    structure: WallMap
    evidence: Evidence
    deformed: DeformedMap | None
    """The deformed map; None if too few tiles fit, so that the map stays as it is."""


class _Fit(NamedTuple):
    """A deformation of a map that starts at a pose, not yet applied to its cells."""

    motion: SE2
    """T_target_source nearest to it."""
    support_m: float
    """Length of wall that supports it, less the weighted length of all other walls [m]."""
    tiles: TileFit | None
    """The deformation by tiles; None if too few of them fit, so that the map stays as it is."""


@dataclass(frozen=True)
class DeformedPoses:
    """The poses of one map in the frame of another, after it was deformed at each of them; each is computed once."""

    target: WallMap
    source: DeformableMap
    config: MergeConfig
    _fits: dict[SE2, _Fit] = field(default_factory=dict)
    _compared: dict[SE2, DeformedPose] = field(default_factory=dict)

    @cached_property
    def proposals(self) -> list[SE2]:
        """The poses of the correlation, without deformation, the best first."""
        return propose(self.target, self.source.structure, self.config.correlation).motions

    def likeliest(self, starts: Sequence[SE2], decoys: Sequence[Evidence]) -> DeformedPose | None:
        """Deform the map at each start; return the most likely pose, or None if none has support."""
        fits = [fit for start in starts if (fit := self._fit(start)).tiles is not None and fit.support_m > 0.0]
        least_m = _WORTH_COMPARING * max((fit.support_m for fit in fits), default=0.0)
        found = self._best([fit for fit in fits if fit.support_m >= least_m])
        likely = confidences([pose.evidence for pose in found], decoys)
        return found[likely.index(max(likely))] if found else None

    def best(self, starts: Sequence[SE2]) -> list[DeformedPose]:
        """Deform the map at each start, if its tiles fit there; return the best supported poses, the best first."""
        return self._best([self._fit(start) for start in starts])

    def _fit(self, start: SE2) -> _Fit:
        if start not in self._fits:
            self._fits[start] = self._fitted(start)
        return self._fits[start]

    def _fitted(self, start: SE2) -> _Fit:
        tiles, source = fit_tiles(self.target, self.source, start, self.config), self.source.structure
        if tiles is not None:
            return _Fit(tiles.deformation.nearest_in_overlap(self.target, source), tiles.support_m, tiles)
        motions, how = refine_all(self.target, source, [start], self.config), self.config.refinement
        support = support_m(self.target, source, motions, self.config.verification, how.some_walls)
        return _Fit(motions[0], float(support[0]), None)

    def _best(self, fits: Sequence[_Fit]) -> list[DeformedPose]:
        """Compare the maps at the best supported poses at different places."""
        by_motion = {fit.motion: fit for fit in reversed(fits)}
        supports = np.array([fit.support_m for fit in by_motion.values()])
        motions = best_distinct(list(by_motion), supports, self.source.structure, _COMPARED)
        return [self._pose(by_motion[motion]) for motion in motions]

    def _pose(self, fit: _Fit) -> DeformedPose:
        if fit.motion not in self._compared:
            self._compared[fit.motion] = self._compare(fit)
        return self._compared[fit.motion]

    def _compare(self, fit: _Fit) -> DeformedPose:
        structure, deformed = self.source.structure, None
        if fit.tiles is not None:
            deformed = deformed_by(fit.tiles.deformation, fit.motion, self.source)
            structure = WallMap.from_grid(deformed.grid, self.config.structure)
        return DeformedPose(
            fit.motion, structure, evidence_near(self.target, structure, fit.motion, self.config), deformed
        )


def evidence_near(target: WallMap, source: WallMap, pose: SE2, config: MergeConfig) -> Evidence:
    """Return the evidence for a pose after its refinement."""
    return examine(target, source, refine_all(target, source, [pose], config)[0], config.verification)
