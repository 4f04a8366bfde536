"""Aligned grids fused cell by cell by a rule of the belief calculus."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.config import Coverage, Rule
from merging.rules import RULES
from merging.warping import canvas_over, offset_in
from tbmslam.grid import TbmGrid
from tbmslam.kernels.fusion import add_layer, finish


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
        `dubois-prade` and `yager` (which make ignorance of it), or the `average` of the masses; and without masses
        `unanimous` (disagreeing cells become unknown), `log-odds` (which add up) and `entropy-filter` (the same, less
        what would make a cell less certain).
    coverage
        `union` keeps the cells that only some sources saw as those fuse them; `overlap`, the paper's strict reading,
        keeps only what every source saw.
    reliabilities
        Probability that each source is to be believed at all; each is discounted by it first (Shafer 1976). A source
        of 0 says nothing where it was, and most rules give what they give without it: `dempster` and `yager` but for
        a single source's conflict, which they remove, `log-odds` and `entropy-filter` in other masses of the same
        probability. Under `disjunctive` it makes unknown all that it saw, under `average` it counts; under
        `dubois-prade` it makes ignorance of conflict that sources bring along, where else another's belief is held.

    Raises
    ------
    ValueError
        If there are no layers, they do not lie on one lattice, or reliabilities are not one for each, within [0, 1].
    """
    trusts = [1.0] * len(layers) if reliabilities is None else list(reliabilities)
    if len(trusts) != len(layers):
        raise ValueError(f"reliabilities must be as many as layers, {len(layers)}, got {len(trusts)}")
    if not all(0.0 <= trust <= 1.0 for trust in trusts):
        raise ValueError(f"reliabilities must lie within [0, 1], got {trusts}")
    canvas = canvas_over([layer.geometry for layer in layers])
    how = RULES[rule]
    kept = np.empty((canvas.rows, canvas.cols, how.width), dtype=np.float32)
    agreed = np.empty((canvas.rows, canvas.cols, 4), dtype=np.float32)  # the conjunction of all, for the conflict
    seen_by = np.zeros((canvas.rows, canvas.cols), dtype=np.uint16)
    for layer, trust in zip(layers, trusts, strict=True):
        row, col = offset_in(canvas, layer.geometry)
        window = np.s_[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        add_layer(how.code, layer.masses, trust, kept[window], agreed[window], seen_by[window])
    conflict = np.empty((canvas.rows, canvas.cols), dtype=np.float32)
    fused = kept if how.width == 4 else np.empty_like(agreed)
    finish(how.code, kept, agreed, seen_by, len(layers) if coverage == "overlap" else 1, fused, conflict)
    return Fusion(TbmGrid(canvas, fused), conflict, seen_by)
