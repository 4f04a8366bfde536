"""A simulated building: its walls as segments, and its free and occupied cells; and an unbounded building."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse

from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray
from tbmslam.io.atomic_file import replacing
from tbmslam.map.map_check import MAX_CELLS
from tbmslam.sensing.laser_scan import FARTHEST_PLACE
from tbmslam.special_file import why_unreadable

Labels = npt.NDArray[np.uint8]


class WorldError(TbmSlamError):
    """A file does not hold a world."""


@dataclass(frozen=True)
class World:
    """The walls that a simulated laser measures."""

    name: str
    seed: int
    walls: FloatArray
    """Segments (N, 4): x0, y0, x1, y1 [m], surfaces of walls and furniture."""
    places: FloatArray
    """Points (M, 2) [m] that robots visit: rooms, parts of corridors. A few may be under furniture; the region that
    connects most of them is the inside."""

    def __post_init__(self) -> None:
        """Check the arrays' shapes, and that there are places."""
        if self.walls.ndim != 2 or self.walls.shape[1] != 4 or not len(self.walls):
            raise ValueError(f"walls must be segments (N, 4), N > 0, got shape {self.walls.shape}")
        if self.places.ndim != 2 or self.places.shape[1] != 2 or not len(self.places):
            raise ValueError(f"places must be points (M, 2), M > 0, got shape {self.places.shape}")
        if not all((np.abs(points) <= FARTHEST_PLACE).all() for points in (self.walls, self.places)):
            raise ValueError(f"walls and places must lie within {FARTHEST_PLACE:.0e} m")

    def bounds(self) -> tuple[float, float, float, float]:
        """Return (min_x, min_y, max_x, max_y) of the walls [m]."""
        return _bounds(self.walls)

    def grid(self, resolution: float = 0.05, margin: float = 0.5) -> GridGeometry:
        """Return a grid of the whole world with a margin [m] on each side."""
        return _covering(self.bounds(), GridGeometry(resolution, 0.0, 0.0, 0, 0), margin)

    def occupancy(self, geometry: GridGeometry, T_world_grid: SE2 | None = None) -> Labels:
        """Return the true label (rows, cols) of each cell of a grid at T_world_grid, by default in the world's frame.

        Labels are as in `tbmslam.belief.masses`: OCCUPIED if a surface passes through the cell, FREE in the rest of the
        inside, UNKNOWN elsewhere.
        """
        T_grid_world = SE2.identity() if T_world_grid is None else T_world_grid.inverse()
        walls = T_grid_world.apply(self.walls.reshape(-1, 2, 2)).reshape(-1, 4)
        places = T_grid_world.apply(self.places)
        # Free space may be connected outside of these cells.
        whole = _covering(_bounds(walls), geometry, geometry.resolution)
        if whole.rows * whole.cols > MAX_CELLS:
            raise WorldError(
                f"the world {self.name} and the map reach together over {whole.rows} x {whole.cols} cells: give the "
                f"pose of the map in it, or use coarser cells"
            )
        labels = np.full((whole.rows, whole.cols), UNKNOWN, dtype=np.uint8)
        occupied = _cells_with_walls(walls, whole)
        regions, _ = ndimage.label(~occupied)
        cells = [whole.cell_at(float(x), float(y)) for x, y in places]
        at_places = [regions[row, col] for row, col in cells if 0 <= row < whole.rows and 0 <= col < whole.cols]
        inside = np.bincount(at_places, minlength=2)[1:].argmax() + 1  # region 0 is the walls
        labels[regions == inside] = FREE
        labels[occupied] = OCCUPIED
        return _window(labels, whole, geometry)

    def save(self, path: Path) -> None:
        """Write the world atomically as .npz; equal worlds give equal bytes."""
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, name=np.array(self.name), seed=np.array(self.seed), walls=self.walls, places=self.places)


def load_world(path: Path) -> World:
    """Read a world that `World.save` wrote, from a .npz file or a folder with `world.npz`."""
    file = path / "world.npz" if path.is_dir() else path
    try:
        if not (why := why_unreadable(file)):
            with file.open("rb") as opened, np.load(opened, allow_pickle=False) as arrays:
                walls = np.asarray(arrays["walls"], dtype=np.float64)
                places = np.asarray(arrays["places"], dtype=np.float64)
                return World(str(arrays["name"]), int(arrays["seed"]), walls, places)
    except Exception as error:  # damaged zips and headers raise many types, also zlib.error and tokenize.TokenError
        raise WorldError(f"{file} is not a world: {error}; make one with `tbmslam world`") from error
    raise WorldError(f"{file} {why}; make a world with `tbmslam world`")


def _bounds(walls: FloatArray) -> tuple[float, float, float, float]:
    """Return (min_x, min_y, max_x, max_y) of segments (N, 4)."""
    points = walls.reshape(-1, 2)
    (min_x, min_y), (max_x, max_y) = points.min(axis=0), points.max(axis=0)
    return float(min_x), float(min_y), float(max_x), float(max_y)


def _covering(bounds: tuple[float, float, float, float], cells: GridGeometry, margin: float) -> GridGeometry:
    """Return a grid on the lattice of `cells` that contains both it and `bounds`."""
    min_x, min_y, max_x, max_y = bounds
    bottom, left = cells.cell_at(min_x - margin, min_y - margin)
    top, right = cells.cell_at(max_x + margin, max_y + margin)
    if cells.rows:  # of an empty lattice, only the bounds count
        bottom, left = min(bottom, 0), min(left, 0)
    return cells.part(bottom, max(top + 1, cells.rows), left, max(right + 1, cells.cols))


def _window(labels: Labels, whole: GridGeometry, part: GridGeometry) -> Labels:
    row = round((part.origin_y - whole.origin_y) / whole.resolution)
    col = round((part.origin_x - whole.origin_x) / whole.resolution)
    return labels[row : row + part.rows, col : col + part.cols].copy()


def _cells_with_walls(walls: FloatArray, geometry: GridGeometry) -> npt.NDArray[np.bool_]:
    """Return which cells touch a segment. Between two crossings of grid lines, a segment is in one cell."""
    occupied = np.zeros((geometry.rows, geometry.cols), dtype=np.bool_)
    scaled = (walls - [geometry.origin_x, geometry.origin_y] * 2) / geometry.resolution
    for x0, y0, x1, y1 in scaled:
        crossings = np.concatenate(([0.0, 1.0], _crossings(x0, x1), _crossings(y0, y1)))
        crossings.sort()
        middle = (crossings[:-1] + crossings[1:]) / 2.0
        rows = np.floor(y0 + middle * (y1 - y0)).astype(np.int64)
        cols = np.floor(x0 + middle * (x1 - x0)).astype(np.int64)
        occupied[rows, cols] = True
    return occupied


def _crossings(start: float, end: float) -> FloatArray:
    """Return the fractions of the interval from start to end at which whole numbers are crossed."""
    low, high = min(start, end), max(start, end)
    lines = np.arange(np.floor(low) + 1.0, np.ceil(high))
    return (lines - start) / (end - start) if len(lines) else np.zeros(0)


@dataclass(frozen=True)
class CorridorLattice:
    """Corridors with centre lines at the multiples of a pitch in x and in y."""

    seed: int = 0
    pitch: float = 20.0
    """Distance between corridors [m]."""
    width: float = 2.4
    """Width of a corridor [m]."""

    def __post_init__(self) -> None:
        """Check that blocks have room for niches on all sides."""
        if not 0.0 < self.width < self.pitch / 4.0:
            raise ValueError(f"width must be positive and below a quarter of the pitch, got {self.width}, {self.pitch}")

    def walls_near(self, low: tuple[float, float], high: tuple[float, float]) -> FloatArray:
        """Return the segments (N, 4) [m] of every block that touches the box from `low` to `high`, (x, y) [m]."""
        columns, rows = (
            range(math.floor(first / self.pitch), math.floor(last / self.pitch) + 1)
            for first, last in zip(low, high, strict=True)
        )
        return np.vstack([_block(self, column, row) for column in columns for row in rows])


@lru_cache(maxsize=256)
def _block(lattice: CorridorLattice, column: int, row: int) -> FloatArray:
    """Return the outline (N, 4) of the block right of and above the crossing (column, row)."""
    # Seeds must not be negative, but numbers of blocks may be.
    rng = np.random.default_rng([lattice.seed, 31, 2 * abs(column) + (column < 0), 2 * abs(row) + (row < 0)])
    side = lattice.pitch - lattice.width
    outline = np.vstack([_side(side, rng) @ _quarter_turn(turn) for turn in range(4)])
    corner = np.array([column + 0.5, row + 0.5]) * lattice.pitch
    return np.hstack((outline, np.roll(outline, -1, axis=0))) + np.tile(corner, 2)


def _side(side: float, rng: np.random.Generator) -> FloatArray:
    """Return the corners (N, 2) of a block's lower side from left to right without the last, relative to its centre."""
    left, bottom = -side / 2.0, -side / 2.0
    deepest = side / 3.0  # so that niches of two sides, which are in the middle half, do not meet
    points = [(left, bottom)]
    x = left + side / 4.0 + float(rng.uniform(0.0, 1.0))
    while x < side / 4.0:
        wide = float(rng.uniform(0.5, 2.5))
        deep = float(rng.choice([0.1, 0.2, 0.4, rng.uniform(1.0, deepest)]))
        end = min(x + wide, side / 4.0)
        points += [(x, bottom), (x, bottom + deep), (end, bottom + deep), (end, bottom)]
        x = end + float(rng.uniform(0.4, 3.0))
    return np.array(points)


def _quarter_turn(times: int) -> FloatArray:
    """Return the matrix that rotates row vectors counter-clockwise by a number of quarter turns."""
    cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[times]
    return np.array([[cosine, sine], [-sine, cosine]])


_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def graph_of_cells(drivable: BoolArray, cost: FloatArray) -> sparse.csr_array:
    """Return the graph of the true cells (rows, cols), row by row, with edges to their eight neighbours.

    An edge costs the mean of both cells times its length in cells.
    """
    number = np.full(drivable.shape, -1)
    number[drivable] = np.arange(int(drivable.sum()))
    starts, ends, weights = [], [], []
    for rows, cols in _NEIGHBOURS:
        height, width = drivable.shape[0] - rows, drivable.shape[1] - abs(cols)
        here = (slice(0, height), slice(max(0, -cols), max(0, -cols) + width))
        there = (slice(rows, rows + height), slice(max(0, cols), max(0, cols) + width))
        both = drivable[here] & drivable[there]
        starts.append(number[here][both])
        ends.append(number[there][both])
        weights.append((cost[here][both] + cost[there][both]) / 2.0 * np.hypot(rows, cols))
    nodes = int(drivable.sum())
    edges = (np.concatenate(starts), np.concatenate(ends))
    return sparse.csr_array((np.concatenate(weights), edges), shape=(nodes, nodes))
