"""Figure 2: what the conjunctive and the disjunctive rule make of two halves that overlap by little."""

from dataclasses import dataclass

import numpy as np

from merging.fusion.fusion import fuse
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import UNKNOWN, VACUOUS

SHARE = 0.51
"""Of the map's columns that each half keeps."""


@dataclass(frozen=True)
class Halves:
    """A map, its halves, and what became of them; all of one size.

    Parameters
    ----------
    original, left, right
        The map, and its parts.
    conjunctive
        Both by the conjunctive rule, what one alone saw kept.
    disjunctive
        Both by the disjunctive rule as the paper has it: a cell that one does not know becomes unknown.
    union
        Both by the disjunctive rule as it is used here by default: who never saw a cell says nothing about it.
    """

    original: TbmGrid
    left: TbmGrid
    right: TbmGrid
    conjunctive: TbmGrid
    disjunctive: TbmGrid
    union: TbmGrid

    def known_share(self, fused: TbmGrid) -> float:
        """Return how much of what the original knows a fused map knows."""
        return float(fused.is_known().sum() / max(self.original.is_known().sum(), 1))

    def unknown_in_overlap(self, grid: TbmGrid) -> float:
        """Return the mean mass on UNKNOWN of a map in the cells that both halves know."""
        both = self.left.is_known() & self.right.is_known()
        return float(grid.masses[both][:, UNKNOWN].mean()) if both.any() else float("nan")


def fuse_halves(original: TbmGrid, share: float = SHARE) -> Halves:
    """Keep so much of the left and of the right of a map, the rest unknown, and fuse the two.

    Raises
    ------
    ValueError
        If the share is not within [0.5, 1].
    """
    if not 0.5 <= share <= 1.0:
        raise ValueError(f"share must lie within [0.5, 1], got {share}")
    cols = original.geometry.cols
    kept = round(share * cols)
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
