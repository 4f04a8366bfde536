"""Aligned grids fused cell by cell by a rule of the belief calculus."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.config import Coverage, Rule
from merging.warping import canvas_over, offset_in
from tbmslam.belief import CONFLICT, VACUOUS, conjunctive, dempster, disjunctive, normalise
from tbmslam.grid import Masses, TbmGrid
from tbmslam.se2 import FloatArray

RULES: dict[Rule, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "disjunctive": disjunctive,
    "conjunctive": conjunctive,
    "dempster": dempster,
}


@dataclass(frozen=True)
class Fusion:
    """What several grids say together.

    Parameters
    ----------
    grid
        The fused masses.
    conflict
        How much the sources contradict each other in each cell (rows, cols), whatever the rule made of it: the mass
        that the conjunction of their conflict-free beliefs leaves on CONFLICT; 0 where fewer than two saw the cell.
    seen_by
        How many sources saw each cell (rows, cols).
    """

    grid: TbmGrid
    conflict: npt.NDArray[np.float32]
    seen_by: npt.NDArray[np.uint16]


def fuse(layers: Sequence[TbmGrid], rule: Rule = "disjunctive", coverage: Coverage = "union") -> Fusion:
    """Fuse grids whose cells lie on one lattice, in the order given.

    Every rule here is commutative and associative, so the order matters only to the rounding of float32. A source that
    never saw a cell gives no testimony on it, rather than the testimony "unknown": under the disjunctive rule the
    latter would erase what the others know, and a cell made unknown by a contradiction would take the next source's
    word alone.

    Parameters
    ----------
    layers
        The grids, of any size, as `merging.warping.warp` makes them.
    rule
        `disjunctive` (eq. 6), `conjunctive` (eq. 5, which keeps its conflict) or `dempster` (which normalises it).
    coverage
        `union` keeps the cells that only some sources saw as those fuse them; `overlap`, the paper's strict reading,
        keeps only what every source saw.

    Raises
    ------
    ValueError
        If there are no layers, or they do not lie on one lattice.
    """
    canvas = canvas_over([layer.geometry for layer in layers])
    fused = TbmGrid.unknown(canvas)
    agreed = np.empty_like(fused.masses)  # the conjunction of all, which knows the conflict under every rule
    seen_by = np.zeros((canvas.rows, canvas.cols), dtype=np.uint16)
    for layer in layers:
        row, col = offset_in(canvas, layer.geometry)
        window = np.s_[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        _add(layer, fused.masses[window], agreed[window], seen_by[window], RULES[rule])
    if coverage == "overlap":
        fused.masses[seen_by < len(layers)] = VACUOUS
    conflict = np.where(seen_by > 1, agreed[..., CONFLICT], np.float32(0.0))
    return Fusion(fused, conflict, seen_by)


def _add(
    layer: TbmGrid,
    fused: Masses,
    agreed: Masses,
    seen_by: npt.NDArray[np.uint16],
    rule: Callable[[FloatArray, FloatArray], FloatArray],
) -> None:
    """Fuse one more layer into the window of the canvas that it covers."""
    sees = layer.is_known()
    first, again = sees & (seen_by == 0), sees & (seen_by > 0)
    fused[first] = layer.masses[first]
    agreed[first] = normalise(layer.masses[first])
    together = rule(np.asarray(fused[again], np.float64), np.asarray(layer.masses[again], np.float64))
    # Sums of masses multiply: a rounding of each map would grow with their number.
    fused[again] = together / together.sum(axis=-1, keepdims=True)
    agreed[again] = conjunctive(agreed[again], normalise(layer.masses[again]))
    seen_by[sees] += 1
