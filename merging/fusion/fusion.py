"""Aligned grids fused cell by cell by a rule of the belief calculus."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from merging.config import Coverage, Rule
from merging.fusion.warping import canvas_over, offset_in
from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.kernels.grids import fusion
from tbmslam.kernels.grids.fusion import add_layer, finish
from tbmslam.parallel.worker_pool import in_threads


class FusionRule(NamedTuple):
    """How the kernel fuses.

    Parameters
    ----------
    code
        Which of the kernel's rules it is.
    width
        Numbers kept of each cell until all sources have spoken.
    """

    code: int
    width: int


RULES: dict[Rule, FusionRule] = {
    # At least one source is right: disagreement becomes ignorance (the paper's eq. 6; Smets 1993).
    "disjunctive": FusionRule(fusion.DISJUNCTIVE, 4),
    # All are right: agreement sharpens, disagreement stays as conflict (the paper's eq. 5; Smets 1990).
    "conjunctive": FusionRule(fusion.CONJUNCTIVE, 4),
    # The same, the conflict shared out among the rest (Shafer 1976).
    "dempster": FusionRule(fusion.DEMPSTER, 4),
    # What the sources have in common, and where that is nothing, what any of them holds (Dubois and Prade 1988).
    "dubois-prade": FusionRule(fusion.DUBOIS_PRADE, 10),
    # What they have in common; all conflict becomes ignorance (Yager 1987).
    "yager": FusionRule(fusion.YAGER, 4),
    # The mean of the masses (Howard 2006; Li, Hao et al. average probabilities likewise).
    "average": FusionRule(fusion.AVERAGE, 4),
    # Cells are free, occupied or unknown; where sources differ nothing is known (Birk and Carpin 2006). Where only one
    # takes a side, its belief stays.
    "unanimous": FusionRule(fusion.UNANIMOUS, 6),
    # Sources are independent: log odds add up (Saeedi et al. 2012; Moravec 1988).
    "log-odds": FusionRule(fusion.LOG_ODDS, 6),
    # The same, but a sum less certain than its surest source is rejected and that source believed (Saeedi et al.
    # compare with the first map; the surest one makes the order of the maps not matter).
    "entropy-filter": FusionRule(fusion.ENTROPY_FILTER, 6),
}


_CELLS_AT_ONCE = 1 << 17
"""Enough to be worth a thread, and few enough to stay in a cache."""


class Layer(Protocol):
    """Cells that can be read some rows at a time: a `TbmGrid`, or a `PlacedGrid` that is never drawn as a whole."""

    @property
    def geometry(self) -> GridGeometry:
        """Where the cells lie."""

    def masses_of_rows(self, first: int, last: int) -> Masses:
        """Return the masses of the rows from `first` up to, and without, `last`."""


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
    rule
        What made the grid's cells: a rule, or `redrawn`, where all scans were rendered into it anew and no rule was
        applied.
    """

    grid: TbmGrid
    conflict: npt.NDArray[np.float32]
    seen_by: npt.NDArray[np.uint16]
    rule: Rule | Literal["redrawn"] = "disjunctive"


def fuse(
    layers: Sequence[Layer],
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
        The grids, of any size, as `merging.fusion.warping` places or warps them.
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
    fusion = Fusion(
        TbmGrid(canvas, np.empty((canvas.rows, canvas.cols, 4), dtype=np.float32)),
        np.empty((canvas.rows, canvas.cols), dtype=np.float32),
        np.zeros((canvas.rows, canvas.cols), dtype=np.uint16),
        rule,
    )
    required = len(layers) if coverage == "overlap" else 1
    sources = [(*offset_in(canvas, layer.geometry), layer, trust) for layer, trust in zip(layers, trusts, strict=True)]
    height = max(_CELLS_AT_ONCE // max(canvas.cols, 1), 1)
    blocks = [slice(top, min(top + height, canvas.rows)) for top in range(0, canvas.rows, height)]
    in_threads(lambda block: _fuse_rows(sources, RULES[rule], required, block, fusion), blocks)
    return fusion


def _fuse_rows(
    sources: Sequence[tuple[int, int, Layer, float]], how: FusionRule, required: int, block: slice, fusion: Fusion
) -> None:
    """Fill some rows of a fusion; a source is the row and column at which a layer begins, the layer and its trust."""
    fused, conflict, seen_by = fusion.grid.masses[block], fusion.conflict[block], fusion.seen_by[block]
    kept = fused if how.width == 4 else np.empty((*seen_by.shape, how.width), dtype=np.float32)
    agreed = np.empty((*seen_by.shape, 4), dtype=np.float32)  # the conjunction of all, for the conflict
    for row, col, layer, trust in sources:
        first, last = max(block.start, row), min(block.stop, row + layer.geometry.rows)
        if first < last:
            window = np.s_[first - block.start : last - block.start, col : col + layer.geometry.cols]
            masses = layer.masses_of_rows(first - row, last - row)
            add_layer(how.code, masses, trust, kept[window], agreed[window], seen_by[window])
    finish(how.code, kept, agreed, seen_by, required, fused, conflict)


_LEAST = 0.1
"""A cell with less conflict belongs to no place; the blur of walls makes a little everywhere."""


@dataclass(frozen=True)
class ConflictPlace:
    """A connected area of contradiction.

    Parameters
    ----------
    x, y
        Its middle, weighed by conflict, in the merged map's frame [m].
    area_m2
        How large it is [m^2].
    conflict_m2
        The conflict in it summed by area [m^2].
    """

    x: float
    y: float
    area_m2: float
    conflict_m2: float


def conflict_places(fusion: Fusion, count: int = 10) -> list[ConflictPlace]:
    """Return the places with the most conflict, the worst first."""
    labels, number = ndimage.label(fusion.conflict >= _LEAST, np.ones((3, 3)))
    if number == 0:
        return []
    rows, cols = np.nonzero(labels)
    place, weight = labels[rows, cols] - 1, fusion.conflict[rows, cols].astype(np.float64)
    sums, cells = np.bincount(place, weight, number), np.bincount(place, minlength=number)
    row, col = np.bincount(place, weight * rows, number) / sums, np.bincount(place, weight * cols, number) / sums
    g = fusion.grid.geometry
    return [
        ConflictPlace(
            *g.centre_of(float(row[k]), float(col[k])),
            float(cells[k] * g.resolution**2),
            float(sums[k] * g.resolution**2),
        )
        for k in np.argsort(-sums, kind="stable")[:count]
    ]
