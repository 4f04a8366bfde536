"""Manual changes of a map, which can be repeated on a new version of the map."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import RELIABILITY, GridGeometry, TbmGrid, no_cell_error, occupancy_of
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap

Kind = Literal["crop", "rotate", "erase", "free", "occupy", "wall"]
_NUMBERS: dict[str, int] = {"crop": 4, "rotate": 1, "erase": 4, "free": 4, "occupy": 4, "wall": 4}
_MOST_POINTS = 20_000  # largest number of occupied cells that are used to find the rotation of a building
_TURNS_DEG = ((45.0, 0.5), (0.5, 0.05), (0.05, 0.01))
"""Ranges and steps of the tested rotations, from coarse to fine."""
_FARTHEST = 1e5  # largest plausible coordinate [m]


@dataclass(frozen=True)
class MapEdit:
    """A change of a map."""

    kind: Kind
    """"crop" keeps a rectangle; "erase", "free" and "occupy" make one unknown, free or occupied, each from corner to
    opposite corner; "wall" draws one from point to point; "rotate" turns the map about the origin of its frame."""
    values: tuple[float, ...]
    """x0, y0, x1, y1 [m] in the frame that the map has by then; of "rotate" the angle, anticlockwise [degrees]."""

    def __post_init__(self) -> None:
        """Check kind and numbers of the edit."""
        if self.kind not in get_args(Kind):
            raise ValueError(f"an edit must be one of {', '.join(get_args(Kind))}, got {self.kind!r}")
        if len(self.values) != _NUMBERS[self.kind]:
            raise ValueError(f"{self.kind} takes {_NUMBERS[self.kind]} numbers, got {len(self.values)}")
        if not all(abs(value) <= _FARTHEST for value in self.values):
            raise ValueError(f"the numbers of {self.kind} must be within {_FARTHEST:g}, got {self.values}")

    def applied(self, tbm_map: TbmMap) -> TbmMap:
        """Return a map with this change.

        Raises a `ValueError` if the part holds no cell of the map.
        """
        if self.kind == "rotate":
            return tbm_map.rotate(math.radians(self.values[0]))
        x0, y0, x1, y1 = self.values
        if self.kind == "crop":
            return tbm_map.crop(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
        geometry = tbm_map.grid.geometry
        if self.kind == "wall":
            cells = _line(geometry, (x0, y0), (x1, y1))
        else:
            cells = _rectangle(geometry, (min(x0, x1), min(y0, y1)), (max(x0, x1), max(y0, y1)))
        masses = tbm_map.grid.masses.copy()
        if not masses[cells].size:
            raise no_cell_error(geometry, x0, y0, x1, y1)
        masses[cells] = _belief(self.kind)
        return replace(tbm_map, grid=TbmGrid(geometry, masses))


def without_scans(tbm_map: TbmMap) -> TbmMap:
    """Return a map whose drives have only trajectories, since a merge would render keyframes without the edits."""
    nothing = Keyframes.from_scans([], [], [])
    drives = tuple(Drive(drive.name, drive.trajectory, nothing) for drive in tbm_map.drives)
    return replace(tbm_map, drives=drives, links=None)


def angle_to_axes(grid: TbmGrid) -> float:
    """Return the smallest rotation [degrees] that aligns the walls of a map with the axes; 0 without walls.

    The walls of an aligned building are sharp peaks of the histograms of occupied cells over x and over y. Therefore
    the rotation with the largest sum of squares of these histograms is taken.
    """
    rows, cols = np.nonzero(occupancy_of(grid) == 100)
    if not len(rows):
        return 0.0
    points = np.column_stack((cols, rows))[:: 1 + len(rows) // _MOST_POINTS].astype(np.float64)
    points -= points.mean(axis=0)
    best = 0.0
    for reach, step in _TURNS_DEG:
        turns = best + np.arange(-reach, reach + step / 2.0, step)
        sharpness = [_sharpness(points, math.radians(turn)) for turn in turns]
        best = float(turns[int(np.argmax(sharpness))])
    return math.remainder(best, 90.0)


def _sharpness(points: FloatArray, turn: float) -> float:
    """Return the sum of squares of both histograms of points (N, 2) in cells, rotated by an angle [rad]."""
    x = math.cos(turn) * points[:, 0] - math.sin(turn) * points[:, 1]
    y = math.sin(turn) * points[:, 0] + math.cos(turn) * points[:, 1]
    total = 0.0
    for values in (x - x.min(), y - y.min()):
        lower = values.astype(np.int64)
        share = values - lower  # of the next bin, so that the sum is a smooth function of the angle
        counts = np.bincount(lower, 1.0 - share, lower.max() + 2) + np.bincount(lower + 1, share, lower.max() + 2)
        total += float(counts @ counts)
    return total


def keepout_mask(geometry: GridGeometry) -> TbmMap:
    """Return an empty mask for nav2's keepout filter: robots must not enter its occupied cells."""
    return TbmMap(TbmGrid(geometry, np.tile(_belief("free"), (geometry.rows, geometry.cols, 1))))


def _belief(kind: str) -> npt.NDArray[np.float32]:
    """Return the masses (4,) of a drawn cell, with the reliability of a map of another program."""
    masses = np.zeros(4, dtype=np.float32)
    if kind != "erase":
        masses[FREE if kind == "free" else OCCUPIED] = RELIABILITY
    masses[UNKNOWN] = 1.0 - masses.sum()
    return masses


def _rectangle(
    geometry: GridGeometry, low: tuple[float, float], high: tuple[float, float]
) -> tuple[npt.NDArray[Any], ...]:
    """Return an index of the cells with centres in a rectangle."""
    x = geometry.origin_x + (np.arange(geometry.cols) + 0.5) * geometry.resolution
    y = geometry.origin_y + (np.arange(geometry.rows) + 0.5) * geometry.resolution
    inside_x, inside_y = ((values >= a) & (values < b) for values, a, b in zip((x, y), low, high, strict=True))
    return np.ix_(np.asarray(inside_y), np.asarray(inside_x))


def _line(geometry: GridGeometry, begin: tuple[float, float], end: tuple[float, float]) -> tuple[npt.NDArray[Any], ...]:
    """Return rows and columns of the cells of a line, sampled twice per cell."""
    steps = 2 * math.ceil(math.dist(begin, end) / geometry.resolution) + 1
    rows, cols, inside = geometry.cells_at(np.linspace(begin, end, steps))
    return rows[inside], cols[inside]
