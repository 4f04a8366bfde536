"""Fusion of aligned grids: they are brought to one lattice of cells and fused cell by cell by a rule of belief."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from merging.config import Coverage, Rule
from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.belief.grid_resampling import PlacedGrid
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids import fusion
from tbmslam.kernels.grids.fusion import add_layer, finish
from tbmslam.map.map_check import LARGEST_CELL, MAX_CELLS, SMALLEST_CELL
from tbmslam.parallel.worker_pool import in_threads


class CellSizeError(TbmSlamError):
    """Maps cannot be brought into cells of such a size."""


def check_cell_size(resolution: float) -> None:
    """Check the side of a cell [m].

    Raises
    ------
    CellSizeError
        If no map has such cells.
    """
    if not SMALLEST_CELL <= resolution <= LARGEST_CELL:
        raise CellSizeError(
            f"cells of {resolution:g} m are not within {SMALLEST_CELL:g} to {LARGEST_CELL:g} m: correct the "
            "resolution of the maps, --resolution or --compare-at"
        )


def place(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> PlacedGrid:
    """Lay a grid into another frame, on a window just large enough to hold all of it; nothing is drawn yet.

    Parameters
    ----------
    grid
        The source; cells that nobody saw are cut off at its edges first.
    T_target_source
        Pose of the source's frame in the target's frame.
    lattice
        Any grid of the target's frame: the result's cells continue its cells, whatever its size.

    Raises
    ------
    CellSizeError
        If the lattice's cells are far too large or small for the grid.
    """
    known = grid.known_part()
    return PlacedGrid(known, T_target_source, window_over(known.geometry, T_target_source, lattice))


def warp(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> TbmGrid:
    """Resample a grid in another frame; see `place`."""
    return place(grid, T_target_source, lattice).drawn()


def at_resolution(grid: TbmGrid, resolution: float) -> TbmGrid:
    """Return the known part of a grid in cells of another size, in the same frame."""
    known = grid.cropped_to_known()
    if math.isclose(resolution, known.geometry.resolution, rel_tol=1e-6):
        return known
    return warp(known, SE2.identity(), known.geometry._replace(resolution=resolution))


def corners_of(source: GridGeometry, T_target_source: SE2) -> FloatArray:
    """Return the corners (4, 2) of a source grid in the frame it is placed in [m]."""
    left, bottom, right, top = source.bounds()
    return T_target_source.apply([(left, bottom), (right, bottom), (right, top), (left, top)])


def window_over(source: GridGeometry, T_target_source: SE2, lattice: GridGeometry) -> GridGeometry:
    """Return the smallest part of a lattice that covers a source grid placed in its frame."""
    left, bottom, right, top = source.bounds()
    corners = corners_of(source, T_target_source)
    check_cell_size(lattice.resolution)
    cells = (corners - (lattice.origin_x, lattice.origin_y)) / lattice.resolution
    sides = np.ptp(cells, axis=0)
    if not sides.prod() <= MAX_CELLS:
        raise CellSizeError(
            f"a map of {right - left:.3g} x {top - bottom:.3g} m is too large for cells of {lattice.resolution:g} m: "
            "pass coarser ones by --resolution and --compare-at, or correct the map's resolution"
        )
    # Rounding must not add a row of cells that the source does not reach.
    first = np.floor(cells.min(axis=0) + 1e-6).astype(int)
    last = np.ceil(cells.max(axis=0) - 1e-6).astype(int)
    return _window(lattice, first, last)


def canvas_over(windows: list[GridGeometry]) -> GridGeometry:
    """Return the smallest part of the windows' common lattice that covers all of them.

    Raises
    ------
    ValueError
        If there is none, or if they are not cut from one lattice.
    """
    if not windows:
        raise ValueError("windows must not be empty")
    offsets = np.array([offset_in(windows[0], window) for window in windows])
    sizes = np.array([(window.rows, window.cols) for window in windows])
    (top, left), (bottom, right) = offsets.min(axis=0), (offsets + sizes).max(axis=0)
    return _window(windows[0], np.array([left, top]), np.array([right, bottom]))


def offset_in(canvas: GridGeometry, window: GridGeometry) -> tuple[int, int]:
    """Return the (row, col) of a canvas at which a window of the same lattice begins.

    Raises
    ------
    ValueError
        If they are not cut from one lattice.
    """
    row = (window.origin_y - canvas.origin_y) / canvas.resolution
    col = (window.origin_x - canvas.origin_x) / canvas.resolution
    same_size = math.isclose(window.resolution, canvas.resolution, rel_tol=1e-6)
    if not same_size or abs(row - round(row)) > 1e-3 or abs(col - round(col)) > 1e-3:
        raise ValueError(f"grids must be cut from one lattice of cells, got {canvas} and {window}")
    return round(row), round(col)


def _window(lattice: GridGeometry, first: np.ndarray, last: np.ndarray) -> GridGeometry:
    """Return the lattice's cells from the (col, row) `first` up to, and without, `last`."""
    return GridGeometry(
        lattice.resolution,
        lattice.origin_x + float(first[0]) * lattice.resolution,
        lattice.origin_y + float(first[1]) * lattice.resolution,
        int(last[1] - first[1]),
        int(last[0] - first[0]),
    )


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
        The grids, of any size, as `merging.fusion` places or warps them.
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
