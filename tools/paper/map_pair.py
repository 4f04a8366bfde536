"""A pair of maps with their true pose, for all experiments."""

from dataclasses import dataclass

import numpy as np

from merging.fusion import fuse
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import UNKNOWN, VACUOUS
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray


@dataclass(frozen=True)
class MapPair:
    """Two maps of one place."""

    target_name: str
    source_name: str
    target: TbmGrid
    source: TbmGrid
    T_target_source: SE2
    """True pose of the source in the target's frame."""

    @property
    def name(self) -> str:
        """The names of both maps."""
        return f"{self.target_name} - {self.source_name}"

    def is_right(self, target_points: FloatArray, source_points: FloatArray, tolerance_m: float) -> BoolArray:
        """Return which matches (M,) of points (M, 2) [m] are right, within a tolerance [m]."""
        apart = self.T_target_source.apply(source_points.reshape(-1, 2)) - target_points.reshape(-1, 2)
        return np.asarray(np.hypot(*apart.T) <= tolerance_m)

    def displacement_m(self, matrix: FloatArray) -> float:
        """Return the mean error of the source's known cells under a transform (2, 3) [m]."""
        cells = self.source.geometry.centres_of(*np.nonzero(self.source.is_known()))
        found = cells @ matrix[:, :2].T + matrix[:, 2]
        return float(np.hypot(*(found - self.T_target_source.apply(cells)).T).mean())

    def overlap(self) -> float:
        """Return the true overlap, as a share of the smaller map's known cells."""
        there = resample(self.source, self.T_target_source, self.target.geometry).is_known()
        known = self.target.is_known()
        return float((there & known).sum() / max(min(self.source.is_known().sum(), known.sum()), 1))


SHARE = 0.51
"""Share of the map's columns in each half."""


@dataclass(frozen=True)
class Halves:
    """A map, its halves and their fusions, all of the same size."""

    original: TbmGrid
    left: TbmGrid
    right: TbmGrid
    conjunctive: TbmGrid
    """Fusion by the conjunctive rule, with cells that are known in one half only."""
    disjunctive: TbmGrid
    """Fusion by the paper's disjunctive rule: cells that are unknown in a half are unknown."""
    union: TbmGrid
    """Fusion by the disjunctive rule of this project, which ignores unknown cells of a map."""

    def fused(self) -> dict[str, TbmGrid]:
        """Return the fused maps with their names in figure 2."""
        return {
            "d: conjunctive rule": self.conjunctive,
            "e: disjunctive rule, as in the paper": self.disjunctive,
            "disjunctive rule, as used here by default": self.union,
        }

    def known_share(self, fused: TbmGrid) -> float:
        """Return the share of the original's known cells that a fused map knows."""
        return float(fused.is_known().sum() / max(self.original.is_known().sum(), 1))

    def unknown_in_overlap(self, grid: TbmGrid) -> float:
        """Return the mean mass on UNKNOWN of a map in cells that are known in both halves."""
        both = self.left.is_known() & self.right.is_known()
        return float(grid.masses[both][:, UNKNOWN].mean()) if both.any() else float("nan")


def fuse_halves(original: TbmGrid) -> Halves:
    """Fuse the left and the right part of a map."""
    cols = original.geometry.cols
    kept = round(SHARE * cols)
    left, right = (TbmGrid(original.geometry, original.masses.copy()) for _ in range(2))
    left.masses[:, kept:] = VACUOUS.astype(np.float32)
    right.masses[:, : cols - kept] = VACUOUS.astype(np.float32)
    return Halves(
        original,
        left,
        right,
        conjunctive=fuse([left, right], "conjunctive").grid,
        disjunctive=fuse([left, right], "disjunctive", "overlap").grid,
        union=fuse([left, right], "disjunctive").grid,
    )
