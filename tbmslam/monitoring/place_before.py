"""What was seen of a place before, held against what is seen there now: whether both are one place."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy import ndimage

from tbmslam.frozen_config import FrozenConfig
from tbmslam.kernels.seen_space import are_seen_through, seen_distances
from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import SE2, FloatArray
from tbmslam.tracking.seen_space import small_things

_CELL = 0.1  # [m]
_SAME, _APART = 1, 3  # cells: what is so near is the same, what is farther is not
_BLOCK, _FEWEST_VIEWS = 3, 3  # cells of a side; views in which something must be there
_AROUND = np.array([(0.0, 0.0), (0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.0, -0.15)])  # [m]
_MOST_VIEWS = 400  # a robot that turns and turns goes no way
_MOST_DIRECTIONS = 360


class PlaceBeforeConfig(FrozenConfig):
    """How two views of a place are held against each other."""

    reach: float = Field(10.0, gt=0, description="hits farther from the laser are not compared [m]")
    around: float = Field(15.0, gt=0, description="nor any farther from the place [m]")
    within: float = Field(2.0, ge=0, description="nor any within this, the place's own walls [m]")
    depth: float = Field(0.3, gt=0, description="how far a scan must go on behind a place to see through it [m]")


class View(NamedTuple):
    """A scan, as far as it is compared.

    Parameters
    ----------
    T_map_sensor
        Where it was taken.
    points
        Its hits (M, 2) on walls, without things as small as people, in the map [m].
    seen
        How far all is empty in each of some directions (D,) around the laser [m].
    """

    T_map_sensor: SE2
    points: FloatArray
    seen: FloatArray

    @classmethod
    def of(cls, scan: LaserScan, T_map_sensor: SE2, reach: float) -> "View":
        """Look at a scan."""
        hits = scan.hit_points()
        directions = min(_MOST_DIRECTIONS, max(int(2.0 * np.pi / max(abs(scan.angle_increment), 1e-6)), 1))
        kept = hits[~small_things(hits) & (np.hypot(hits[:, 0], hits[:, 1]) <= reach)] if len(hits) else hits
        return cls(T_map_sensor, T_map_sensor.apply(kept), seen_distances(hits, directions))


class Contrast(NamedTuple):
    """How much wall two views of a place have in common, and how much not.

    Parameters
    ----------
    agreeing
        Length of walls that were there before and are there [m].
    standing
        Length of walls that stand where was seen through before [m].
    gone
        Length of walls that were there before and are seen through [m].
    """

    agreeing: float
    standing: float
    gone: float

    def contradicting(self) -> float:
        """Return the length that contradicts both ways: who walks about, or a door that opens, does so in one [m]."""
        return min(self.standing, self.gone)


class PlaceBefore:
    """Remembers what was seen around a place, and compares what is seen from now on.

    Parameters
    ----------
    views
        What was seen.
    T_map_place
        Where the robot stood.
    config
        How they are compared.
    """

    def __init__(self, views: Iterable[View], T_map_place: SE2, config: PlaceBeforeConfig) -> None:
        self._config = config
        self._place = np.array((T_map_place.x, T_map_place.y))
        blocks = 2 * round(config.around / (_BLOCK * _CELL))
        side = _BLOCK * blocks
        self._half = 0.5 * _CELL * side
        self._before, self._now, self._standing, self._gone = (np.zeros((side, side), dtype=np.bool_) for _ in range(4))
        self._times = np.zeros((blocks, blocks), dtype=np.int64)  # in how many views of now something was there
        self._views_before, self._views_now = list(views), deque[View](maxlen=_MOST_VIEWS)
        times = np.zeros_like(self._times)
        for view in self._views_before:
            self._before[self._noted(view, times)] = True
        self._before = self._standing_still(self._before & _often(times), self._views_before)
        self._walls = self._places(self._before)
        self._same_before, self._near_before = (_grown(self._before, cells) for cells in (_SAME, _APART))

    def see(self, view: View) -> None:
        """Compare what is seen now."""
        cells = self._noted(view, self._times)
        self._now[cells] = True
        points = self._compared(view.points)
        new = points[~self._near_before[cells]]
        self._standing[self._cells(new[self._are_seen_through(new, self._views_before)])] = True
        self._views_now.append(view)
        near = np.hypot(*(self._walls - view.T_map_sensor[:2]).T) <= self._config.reach
        walls = self._walls[near]
        self._gone[self._cells(walls[self._are_seen_through(walls, [view])])] = True

    def contrast(self) -> Contrast:
        """Return how both compare by now."""
        agreeing = self._now & self._same_before
        standing = self._standing_still(self._standing & _often(self._times), self._views_now)
        gone = self._gone & ~_grown(self._now, _APART)
        return Contrast(*(_CELL * int(np.count_nonzero(those)) for those in (agreeing, standing, gone)))

    def _standing_still(self, cells: npt.NDArray[np.bool_], views: Sequence[View]) -> npt.NDArray[np.bool_]:
        """Return those cells through which none of the views that tell of them saw: who walks to and fro lets see."""
        kept, places = cells.copy(), self._places(cells)
        kept[self._cells(places[self._are_seen_through(places, views)])] = False
        return kept

    def _are_seen_through(self, points: FloatArray, views: Sequence[View]) -> npt.NDArray[np.bool_]:
        """Return through which places (M, 2) any view saw, and through what is around them: beams graze walls."""
        if not len(points):  # mostly
            return np.zeros(0, dtype=np.bool_)
        lasers = np.array([view.T_map_sensor for view in views]).reshape(-1, 3)
        begins = np.cumsum([0, *(len(view.seen) for view in views)])
        seen = np.concatenate([np.zeros(0), *(view.seen for view in views)])
        return are_seen_through(points, _AROUND, lasers, seen, begins, self._config.depth)

    def _places(self, cells: npt.NDArray[np.bool_]) -> FloatArray:
        """Return the centres (M, 2) of cells."""
        places: FloatArray = (np.argwhere(cells) + 0.5) * _CELL - self._half + self._place
        return places

    def _noted(self, view: View, times: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the cells that a view hits, and count the view for each block of them."""
        cells = self._cells(self._compared(view.points))
        hit = np.zeros(times.shape, dtype=np.bool_)
        hit[cells[0] // _BLOCK, cells[1] // _BLOCK] = True
        times += hit
        return cells

    def _compared(self, points: FloatArray) -> FloatArray:
        away = points - self._place
        distances = np.hypot(away[:, 0], away[:, 1])
        kept: FloatArray = points[(distances > self._config.within) & (np.abs(away).max(axis=1) < self._half)]
        return kept

    def _cells(self, points: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        cells = np.floor((points - self._place + self._half) / _CELL).astype(np.int64)
        return cells[:, 0], cells[:, 1]


def _often(times: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return in which cells something was there in several views, as walls are, and who walks is not."""
    often: npt.NDArray[np.bool_] = np.kron(times >= _FEWEST_VIEWS, np.ones((_BLOCK, _BLOCK), dtype=np.bool_))
    return often


def _grown(those: npt.NDArray[np.bool_], cells: int) -> npt.NDArray[np.bool_]:
    size = 2 * cells + 1
    grown: npt.NDArray[np.bool_] = ndimage.maximum_filter(those, size=size)
    return grown
