"""Aligned grids fused cell by cell by a rule of the belief calculus."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.config import Coverage, Rule
from merging.rules import RULES, FusionRule
from merging.warping import canvas_over, offset_in
from tbmslam.belief import CONFLICT, VACUOUS, conjunctive, discount, normalise
from tbmslam.grid import Masses, TbmGrid
from tbmslam.se2 import FloatArray


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


def fuse(
    layers: Sequence[TbmGrid],
    rule: Rule = "disjunctive",
    coverage: Coverage = "union",
    reliabilities: Sequence[float] | None = None,
) -> Fusion:
    """Fuse grids whose cells lie on one lattice.

    The order of the grids matters only to the rounding of numbers under every rule. A source that never saw a cell
    gives no testimony on it, rather than the testimony "unknown": under the disjunctive rule the latter would erase
    what the others know, and a cell made unknown by a contradiction would take the next source's word alone.

    Parameters
    ----------
    layers
        The grids, of any size, as `merging.warping.warp` makes them.
    rule
        `disjunctive` (eq. 6), `conjunctive` (eq. 5, which keeps its conflict), `dempster` (which normalises it),
        `dubois-prade` and `yager` (which make ignorance of it), or the `average` of the masses.
    coverage
        `union` keeps the cells that only some sources saw as those fuse them; `overlap`, the paper's strict reading,
        keeps only what every source saw.
    reliabilities
        Probability that each source is to be believed at all; each is discounted by it first (Shafer 1976).

    Raises
    ------
    ValueError
        If there are no layers, they do not lie on one lattice, or there are more or fewer reliabilities.
    """
    trusts = [1.0] * len(layers) if reliabilities is None else list(reliabilities)
    if len(trusts) != len(layers):
        raise ValueError(f"reliabilities must be as many as layers, {len(layers)}, got {len(trusts)}")
    canvas = canvas_over([layer.geometry for layer in layers])
    kept = np.zeros((canvas.rows, canvas.cols, RULES[rule].width), dtype=np.float32)
    agreed = np.empty((canvas.rows, canvas.cols, 4), dtype=np.float32)  # the conjunction of all, for the conflict
    seen_by = np.zeros((canvas.rows, canvas.cols), dtype=np.uint16)
    for layer, trust in zip(layers, trusts, strict=True):
        row, col = offset_in(canvas, layer.geometry)
        window = np.s_[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        _add(layer, trust, kept[window], agreed[window], seen_by[window], RULES[rule])
    fused = TbmGrid.unknown(canvas)
    seen = seen_by > 0
    fused.masses[seen] = RULES[rule].finish(kept[seen].astype(np.float64), seen_by[seen].astype(np.float64))
    if coverage == "overlap":
        fused.masses[seen_by < len(layers)] = VACUOUS
    conflict = np.where(seen_by > 1, agreed[..., CONFLICT], np.float32(0.0))
    return Fusion(fused, conflict, seen_by)


def _add(
    layer: TbmGrid,
    trust: float,
    kept: npt.NDArray[np.float32],
    agreed: Masses,
    seen_by: npt.NDArray[np.uint16],
    rule: FusionRule,
) -> None:
    """Fuse one more layer into the window of the canvas that it covers."""
    sees = layer.is_known()
    first, again = sees & (seen_by == 0), sees & (seen_by > 0)
    new, more = _believed(layer.masses[first], trust), _believed(layer.masses[again], trust)
    kept[first] = rule.start(new)
    agreed[first] = normalise(new)
    kept[again] = rule.add(kept[again].astype(np.float64), more)
    agreed[again] = conjunctive(agreed[again], normalise(more))
    seen_by[sees] += 1


def _believed(masses: Masses, trust: float) -> FloatArray:
    exact = np.asarray(masses, dtype=np.float64)
    return exact if trust == 1.0 else discount(exact, trust)
