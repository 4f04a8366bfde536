"""A picture of the walls of two maps at a relative pose."""

from dataclasses import dataclass, replace

import numpy as np

from merging.config import MergeConfig
from merging.config.registration import VerificationConfig
from merging.fusion import at_resolution
from merging.walls import BoolArray, WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.walls import FACING
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


@dataclass(frozen=True)
class _Canvas:
    """Pixels over a rectangle; row 0 has the smallest y."""

    left: float
    bottom: float
    step: float
    rows: int
    cols: int

    @classmethod
    def over(cls, points: FloatArray, least_step: float) -> "_Canvas":
        low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
        step = max(float((high - low).max()) / _PIXELS_ALONG, least_step)
        cols, rows = np.ceil((high - low) / step).astype(int)
        return cls(float(low[0]), float(low[1]), step, int(rows), int(cols))

    def centres(self) -> FloatArray:
        """Return the centres (rows * cols, 2) of all pixels."""
        x = self.left + (np.arange(self.cols) + 0.5) * self.step
        y = self.bottom + (np.arange(self.rows) + 0.5) * self.step
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def draw(self, picture: Levels, points: FloatArray, level: int) -> None:
        """Paint the pixels that hold points."""
        cols, rows = ((points - (self.left, self.bottom)) / self.step).astype(int).T
        picture[rows, cols] = level


def draw_pair(target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig) -> bytes:
    """Return a PNG of the target's walls and the transformed walls of the source."""
    moved = T_target_source.apply(source.points)
    canvas = _Canvas.over(
        np.vstack((_corners(target, SE2.identity()), _corners(source, T_target_source))),
        max(target.geometry.resolution, source.geometry.resolution),
    )
    centres = canvas.centres()
    known = _is_known(target, centres).astype(int) + _is_known(source, T_target_source.inverse().apply(centres))
    picture = np.choose(known, (_NEITHER, _ONE, _BOTH)).astype(np.uint8).reshape(canvas.rows, canvas.cols)
    forth = _compared(source, target, T_target_source, config)
    back = _compared(target, source, T_target_source.inverse(), config)
    canvas.draw(picture, target.points, _TARGET)
    canvas.draw(picture, moved, _SOURCE)
    for which, level in ((0, _AGREED), (1, _CONTRADICTED)):
        canvas.draw(picture, target.points[back[which]], level)
        canvas.draw(picture, moved[forth[which]], level)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def draw_alone(structure: WallMap) -> bytes:
    """Return a PNG of the walls of one map."""
    canvas = _Canvas.over(_corners(structure, SE2.identity()), structure.geometry.resolution)
    known = _is_known(structure, canvas.centres())
    picture = np.where(known, np.uint8(_ONE), np.uint8(_NEITHER)).reshape(canvas.rows, canvas.cols)
    canvas.draw(picture, structure.points, _TARGET)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def _corners(structure: WallMap, T_canvas_map: SE2) -> FloatArray:
    """Return the corners (4, 2) of the known area of a map."""
    g = structure.geometry
    rows, cols = (np.flatnonzero(structure.states.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows = cols = np.zeros(1, dtype=int)
    x = g.origin_x + np.array([cols[0], cols[-1] + 1]) * g.resolution
    y = g.origin_y + np.array([rows[0], rows[-1] + 1]) * g.resolution
    return T_canvas_map.apply([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])


def _is_known(structure: WallMap, points: FloatArray) -> BoolArray:
    rows, cols, inside = structure.geometry.cells_at(points)
    return np.asarray(inside & (structure.states[rows, cols] > 0))


def _compared(
    moving: WallMap, fixed: WallMap, T_fixed_moving: SE2, config: VerificationConfig
) -> tuple[BoolArray, BoolArray]:
    """Return which walls (N,) agree with the other map, and which contradict it; see `compare_walls`."""
    if not len(fixed.points) or not len(moving.points):
        nothing = np.zeros(len(moving.points), dtype=bool)
        return nothing, nothing
    rows, cols, inside = fixed.geometry.cells_at(T_fixed_moving.apply(moving.points))
    distances, nearest = fixed.distances_m[rows, cols], fixed.nearest[rows, cols]
    facing = (SE2(0.0, 0.0, T_fixed_moving.theta).apply(moving.normals) * fixed.normals[nearest]).sum(axis=1)
    alike = (facing >= FACING) | ((moving.two_sided | fixed.two_sided[nearest]) & (facing <= -FACING))
    agreed = inside & alike & (distances <= config.agreement_distance_m)
    return agreed, inside & (fixed.states[rows, cols] == 1) & (distances > config.conflict_distance_m)


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
