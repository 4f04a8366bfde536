"""A picture of the walls of two maps at a relative pose."""

from dataclasses import dataclass, replace

import numpy as np

from merging.config import MergeConfig
from merging.config.registration import VerificationConfig
from merging.fusion import at_resolution
from merging.walls import BoolArray, WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import corners_of
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.walls import AGREES, CONFLICTS, classify_walls
from tbmslam.report.sheet import Levels, Palette

_NEITHER, _ONE, _BOTH, _TARGET, _SOURCE, _AGREED, _CONTRADICTED = range(7)
_PALETTE = Palette(
    ((248, 249, 251), (232, 236, 241), (214, 224, 236), (28, 94, 170), (222, 130, 20), (16, 138, 76), (206, 22, 28))
)
CAPTION = (
    "Walls of {target} are blue, of {source} orange. Green walls agree, red walls lie in the other map's free space. "
    "The darker ground is known to both maps."
)
EVIDENCE_GRIDS = "The picture shows the deformed or short-range maps that were compared."
_PIXELS_ALONG = 520
_MARGIN_M = 0.5


def _canvas_over(points: FloatArray, least_step: float) -> GridGeometry:
    """Return the pixels of a picture of points (N, 2) [m] with a margin."""
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    step = max(float((high - low).max()) / _PIXELS_ALONG, least_step)
    cols, rows = np.ceil((high - low) / step).astype(int).tolist()
    return GridGeometry(step, float(low[0]), float(low[1]), rows, cols)


def _pixels_of(canvas: GridGeometry) -> FloatArray:
    """Return the centres (rows * cols, 2) of all pixels."""
    return canvas.centres_of(*np.divmod(np.arange(canvas.rows * canvas.cols), canvas.cols))


def _paint(picture: Levels, canvas: GridGeometry, points: FloatArray, level: int) -> None:
    """Paint the pixels that hold points (N, 2)."""
    rows, cols, _ = canvas.cells_at(points)
    picture[rows, cols] = level


def draw_pair(target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig) -> bytes:
    """Return a PNG of the target's walls and the transformed walls of the source."""
    moved = T_target_source.apply(source.points)
    canvas = _canvas_over(
        np.vstack((_corners(target, SE2.identity()), _corners(source, T_target_source))),
        max(target.geometry.resolution, source.geometry.resolution),
    )
    centres = _pixels_of(canvas)
    known = target.knows(centres).astype(int) + source.knows(T_target_source.inverse().apply(centres))
    picture = np.choose(known, (_NEITHER, _ONE, _BOTH)).astype(np.uint8).reshape(canvas.rows, canvas.cols)
    forth = _compared(source, target, T_target_source, config)
    back = _compared(target, source, T_target_source.inverse(), config)
    _paint(picture, canvas, target.points, _TARGET)
    _paint(picture, canvas, moved, _SOURCE)
    for which, level in ((0, _AGREED), (1, _CONTRADICTED)):
        _paint(picture, canvas, target.points[back[which]], level)
        _paint(picture, canvas, moved[forth[which]], level)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def draw_alone(structure: WallMap) -> bytes:
    """Return a PNG of the walls of one map."""
    canvas = _canvas_over(_corners(structure, SE2.identity()), structure.geometry.resolution)
    known = structure.knows(_pixels_of(canvas))
    picture = np.where(known, np.uint8(_ONE), np.uint8(_NEITHER)).reshape(canvas.rows, canvas.cols)
    _paint(picture, canvas, structure.points, _TARGET)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def _corners(structure: WallMap, T_canvas_map: SE2) -> FloatArray:
    """Return the corners (4, 2) of the known area of a map."""
    rows, cols = (np.flatnonzero(structure.states.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows = cols = np.zeros(1, dtype=int)
    known = structure.geometry.part(int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1)
    return corners_of(known, T_canvas_map)


def _compared(
    moving: WallMap, fixed: WallMap, T_fixed_moving: SE2, config: VerificationConfig
) -> tuple[BoolArray, BoolArray]:
    """Return which walls (N,) agree with the other map, and which contradict it."""
    every = np.arange(len(moving.points))
    held = classify_walls(moving.walls, every, fixed.walls, T_fixed_moving, config.limits())
    return held == AGREES, held == CONFLICTS


@dataclass(frozen=True)
class ComparedGrids:
    """The grids that an alignment was computed from, kept for its picture."""

    target: TbmGrid
    source: TbmGrid
    resolution: float
    """Cell size at which they were compared [m]."""
    config: MergeConfig
    note: str = ""
    """A sentence below the picture."""

    def reversed(self) -> "ComparedGrids":
        """Return the grids with target and source exchanged."""
        return replace(self, target=self.source, source=self.target)

    def png(self, T_target_source: SE2) -> bytes:
        """Draw the walls of both grids as a PNG."""
        target, source = (
            WallMap.from_grid(at_resolution(grid, self.resolution), self.config.structure)
            for grid in (self.target, self.source)
        )
        return draw_pair(target, source, T_target_source, self.config.verification)
