"""Fusion of aligned grids: they are brought to one lattice of cells and fused cell by cell by a rule of belief."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from merging.config import Coverage, Rule
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import PlacedGrid, corners_of
from tbmslam.belief.masses import Masses
from tbmslam.belief.tiled_masses import SIDE, TiledMasses, sparse_zeros
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids import fusion
from tbmslam.kernels.grids.fusion import add_layer, finish
from tbmslam.map.map_check import LARGEST_CELL, MAX_CELLS, SMALLEST_CELL
from tbmslam.parallel.worker_pool import in_threads


class CellSizeError(TbmSlamError):
    """Maps cannot be brought into cells of such a size."""


def check_cell_size(resolution: float) -> None:
    """Raise a `CellSizeError` if no map has cells of this side [m]."""
    if not SMALLEST_CELL <= resolution <= LARGEST_CELL:
        raise CellSizeError(
            f"cells of {resolution:g} m are not within {SMALLEST_CELL:g} to {LARGEST_CELL:g} m: correct the "
            "resolution of the maps, --resolution or --compare-at"
        )


def place(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> PlacedGrid:
    """Place a grid in another frame, on the smallest window with all known cells; cells are resampled when read.

    The window lies on the cells of `lattice`, a geometry of the target's frame. Raises a `CellSizeError` if these are
    far too large or small for the grid.
    """
    known = grid.known_part()
    return PlacedGrid(known, T_target_source, window_over(known.geometry, T_target_source, lattice))


def warp(grid: TbmGrid, T_target_source: SE2, lattice: GridGeometry) -> TbmGrid:
    """Resample a grid in another frame; see `place`."""
    return place(grid, T_target_source, lattice).drawn()


def at_resolution(grid: TbmGrid, resolution: float) -> TbmGrid:
    """Return the known part of a grid at another resolution [m], in the same frame."""
    known = grid.cropped_to_known()
    if math.isclose(resolution, known.geometry.resolution, rel_tol=1e-6):
        return known
    return warp(known, SE2.identity(), known.geometry._replace(resolution=resolution))


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
    first_col, first_row = np.floor(cells.min(axis=0) + 1e-6).astype(int).tolist()
    last_col, last_row = np.ceil(cells.max(axis=0) - 1e-6).astype(int).tolist()
    return lattice.part(first_row, last_row, first_col, last_col)


def canvas_over(windows: list[GridGeometry]) -> GridGeometry:
    """Return the smallest part of the common lattice that covers all windows; raise a `ValueError` if there is none."""
    if not windows:
        raise ValueError("windows must not be empty")
    offsets = np.array([offset_in(windows[0], window) for window in windows])
    sizes = np.array([(window.rows, window.cols) for window in windows])
    (top, left), (bottom, right) = offsets.min(axis=0).tolist(), (offsets + sizes).max(axis=0).tolist()
    return windows[0].part(top, bottom, left, right)


def offset_in(canvas: GridGeometry, window: GridGeometry) -> tuple[int, int]:
    """Return the (row, col) of a canvas at which a window begins; raise a `ValueError` without a common lattice."""
    row = (window.origin_y - canvas.origin_y) / canvas.resolution
    col = (window.origin_x - canvas.origin_x) / canvas.resolution
    same_size = math.isclose(window.resolution, canvas.resolution, rel_tol=1e-6)
    if not same_size or abs(row - round(row)) > 1e-3 or abs(col - round(col)) > 1e-3:
        raise ValueError(f"grids must be cut from one lattice of cells, got {canvas} and {window}")
    return round(row), round(col)


class FusionRule(NamedTuple):
    """A rule of the fusion kernel."""

    code: int
    width: int
    """Numbers that are stored for each cell until all sources are fused."""


RULES: dict[Rule, FusionRule] = {
    # At least one source is right: disagreement becomes ignorance (the paper's eq. 6; Smets 1993).
    "disjunctive": FusionRule(fusion.DISJUNCTIVE, 4),
    # All sources are right: disagreement stays as conflict (the paper's eq. 5; Smets 1990).
    "conjunctive": FusionRule(fusion.CONJUNCTIVE, 4),
    # The conjunctive rule; the conflict is divided among the other masses (Shafer 1976).
    "dempster": FusionRule(fusion.DEMPSTER, 4),
    # The conjunctive rule for compatible sets, and the disjunctive rule for contradicting ones (Dubois and Prade 1988).
    "dubois-prade": FusionRule(fusion.DUBOIS_PRADE, 10),
    # The conjunctive rule; all conflict becomes ignorance (Yager 1987).
    "yager": FusionRule(fusion.YAGER, 4),
    # The mean of the masses (Howard 2006; Li, Hao et al. average probabilities likewise).
    "average": FusionRule(fusion.AVERAGE, 4),
    # Cells are free, occupied or unknown. Cells of contradicting sources are unknown (Birk and Carpin 2006). A belief
    # that no source contradicts is kept.
    "unanimous": FusionRule(fusion.UNANIMOUS, 6),
    # Sources are independent: log odds add up (Saeedi et al. 2012; Moravec 1988).
    "log-odds": FusionRule(fusion.LOG_ODDS, 6),
    # Log odds; a sum that is less certain than its most certain source is replaced by that source. Saeedi et al.
    # compare with the first map. The most certain map makes the result independent of the order.
    "entropy-filter": FusionRule(fusion.ENTROPY_FILTER, 6),
}


_CELLS_AT_ONCE = 1 << 17
"""Cells of a task: enough for a thread, and few enough for the cache."""


class Layer(Protocol):
    """Cells that can be read in bands of rows: a `TbmGrid`, or a `PlacedGrid`."""

    @property
    def geometry(self) -> GridGeometry:
        """The geometry of the cells."""

    def masses_of_rows(self, first: int, last: int) -> Masses:
        """Return the masses of the rows from `first` up to, and without, `last`."""


@dataclass(frozen=True)
class Fusion:
    """The fusion of several grids."""

    grid: TbmGrid
    conflict: npt.NDArray[np.float32]
    """The contradiction of the sources in each cell (rows, cols), equal for all rules: the mass on CONFLICT of the
    conjunction of their conflict-free beliefs. Cells of fewer than two sources have 0."""
    seen_by: npt.NDArray[np.uint16]
    """The number of sources that saw each cell (rows, cols)."""
    rule: Rule | Literal["redrawn"] = "disjunctive"
    """The rule of the masses, or `redrawn` if all scans were rendered into the grid and no rule was applied."""

    def conflict_m2(self) -> float:
        """Return the contradicted area, weighted by the mass on CONFLICT [m^2]."""
        return float(self.conflict.sum(dtype=np.float64) * self.grid.geometry.resolution**2)


def fuse(
    layers: Sequence[Layer],
    rule: Rule = "disjunctive",
    coverage: Coverage = "union",
    reliabilities: Sequence[float] | None = None,
) -> Fusion:
    """Fuse grids whose cells lie on one lattice.

    The order of the grids affects only the rounding. A source that did not see a cell gives no evidence for it. It does
    not give the evidence "unknown": that would erase the evidence of other sources under the disjunctive rule.

    Parameters
    ----------
    layers
        The grids, of any size, as `place` or `warp` returns them.
    rule
        One of `RULES`: `disjunctive` (eq. 6), `conjunctive` (eq. 5, keeps the conflict), `dempster` (normalises it),
        `dubois-prade` and `yager` (turn it into ignorance), the `average` of the masses, `unanimous` (contradicting
        cells are unknown), `log-odds` (which add up), and `entropy-filter` (log odds that never get less certain).
    coverage
        `union` also keeps the cells that only some sources saw. `overlap`, the paper's strict definition, keeps only
        cells that every source saw.
    reliabilities
        Reliability of each source, by which it is discounted first (Shafer 1976). With 0 a source is vacuous where it
        saw cells. With `conjunctive` the masses are as if it was left out; with `unanimous` too, unless the only other
        source of a cell is undecided. But `dempster` and `yager` also remove the conflict of a single source,
        `log-odds` and `entropy-filter` give other masses of the same probability, `disjunctive` makes its cells
        unknown, `average` counts it, and `dubois-prade` turns conflict within sources into ignorance.

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
    masses = TiledMasses(canvas.rows, canvas.cols)
    fusion = Fusion(
        TbmGrid(canvas, masses),
        sparse_zeros((canvas.rows, canvas.cols), np.float32),
        sparse_zeros((canvas.rows, canvas.cols), np.uint16),
        rule,
    )
    required = len(layers) if coverage == "overlap" else 1
    sources = [(*offset_in(canvas, layer.geometry), layer, trust) for layer, trust in zip(layers, trusts, strict=True)]
    height = max(_CELLS_AT_ONCE // max(canvas.cols, 1) // SIDE, 1) * SIDE
    blocks = [slice(top, min(top + height, canvas.rows)) for top in range(0, canvas.rows, height)]
    in_threads(
        lambda block: masses.put_rows(block.start, _fuse_rows(sources, RULES[rule], required, block, fusion)), blocks
    )
    return fusion


def _fuse_rows(
    sources: Sequence[tuple[int, int, Layer, float]], rule: FusionRule, required: int, block: slice, fusion: Fusion
) -> Masses:
    """Return the masses of some rows of a fusion, and fill its conflict and its counts of sources there.

    A source is the first row and column of a layer, the layer and its reliability.
    """
    rows, cols = block.stop - block.start, fusion.grid.geometry.cols
    fused, conflict = np.empty((rows, cols, 4), dtype=np.float32), np.empty((rows, cols), dtype=np.float32)
    seen_by = np.zeros((rows, cols), dtype=np.uint16)
    kept = fused if rule.width == 4 else np.empty((*seen_by.shape, rule.width), dtype=np.float32)
    agreed = np.empty((*seen_by.shape, 4), dtype=np.float32)  # the conjunction of all, for the conflict
    for row, col, layer, trust in sources:
        first, last = max(block.start, row), min(block.stop, row + layer.geometry.rows)
        if first < last:
            window = np.s_[first - block.start : last - block.start, col : col + layer.geometry.cols]
            masses = layer.masses_of_rows(first - row, last - row)
            add_layer(rule.code, masses, trust, kept[window], agreed[window], seen_by[window])
    finish(rule.code, kept, agreed, seen_by, required, fused, conflict)
    # Zeros are not written, since the arrays of a fusion take memory where they are written.
    for filled, found in ((fusion.conflict[block], conflict), (fusion.seen_by[block], seen_by)):
        np.copyto(filled, found, where=found > 0)
    return fused


_LEAST = 0.1  # least conflict of a cell in a `ConflictPlace`; blurred walls cause a little conflict everywhere


@dataclass(frozen=True)
class ConflictPlace:
    """A connected area of contradiction."""

    x: float
    y: float
    """Centroid of the conflict in the merged map's frame [m]."""
    area_m2: float
    """Area [m^2]."""
    conflict_m2: float
    """Integral of the conflict over the area [m^2]."""


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
