"""A map of surface elements that a scan is laid onto below the size of a cell.

Each cell keeps the moments of the hits in it; a surfel is their mean and spread over the cell and its neighbours, so a
wall is a line with a position and a normal rather than a row of cells. After the normal distributions transform (Biber
and Strasser 2003) with the point-to-line metric (Censi 2008): along a wall the surfel says nothing.
"""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels import Pose
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.surfels.surfel_alignment import NOWHERE, Search, align, place_scan, strays
from tbmslam.kernels.surfels.surfel_search import search
from tbmslam.kernels.surfels.surfels import (
    CELLS,
    SIDE,
    SurfelArrays,
    Surfels,
    add_hits,
    cells_of,
    claim_tiles,
    extent,
    insert_hits,
)
from tbmslam.sensing.laser_scan import Hits, LaserScan
from tbmslam.tracking.tracker import PosePrior


class SurfelConfig(FrozenConfig):
    """What makes a surface element."""

    resolution: float = Field(0.1, gt=0, description="side of a cell; an element gathers three by three [m]")
    noise: float = Field(
        0.01, gt=0, description="standard deviation of a hit beside the spread of those that made its element [m]"
    )
    point_size: float = Field(0.03, ge=0, description="up to this spread an element is a point, not a line [m]")
    clutter: float = Field(0.05, gt=0, description="thickness at which an element counts half [m]")
    certain_hits: float = Field(8.0, gt=0, description="hits from which on an element counts fully")


class Registration(NamedTuple):
    """How a scan fits a surfel map.

    Parameters
    ----------
    pose
        Where the scan's frame lies in the map's.
    hessian
        Curvature (3, 3) of the cost in x, y [1/m^2] and theta there, without the prior.
    matched
        Share of the hits that lie on surfaces, in [0, 1].
    independent
        How many independent hits the scan counts for.
    surprise
        Squared Mahalanobis distance of the pose from the prior's mean.
    """

    pose: SE2
    hessian: FloatArray
    matched: float
    independent: float
    surprise: float


class SurfelMap:
    """Surfels on a lattice that grows with what is inserted; only cells near walls take memory.

    Parameters
    ----------
    config
        What makes a surface element.
    spare
        How much further than needed the lattice grows, so that it need not grow again soon; 0 where all comes at
        once [m].
    slots
        Number of cells that have memory at first, so that the memory need not grow soon.
    """

    def __init__(self, config: SurfelConfig, spare: float = 6.4, slots: int = CELLS) -> None:
        self._spare = SIDE * round(spare / config.resolution / SIDE)
        limits = (config.noise, config.point_size, config.clutter, config.certain_hits)
        self._surfels = Surfels(
            tiles=np.zeros((2, 0, 0), dtype=np.int32),
            moments=np.zeros((slots, 6), dtype=np.float32),
            fits=np.zeros((slots, 8), dtype=np.float32),
            lattice=Lattice(config.resolution, 0, 0),
            limits=limits,
        )
        self._arrays = _plain(self._surfels)
        self._used = 1

    @classmethod
    def of(cls, hits: Hits, config: SurfelConfig) -> "SurfelMap":
        """Return the surfels of hits in the map's frame, with no room to spare."""
        surfaces = cls(config, spare=0.0)
        if len(hits.points):
            surfaces._fill(hits)
        return surfaces

    @property
    def slots(self) -> int:
        """How many cells have memory."""
        return len(self._surfels.moments)

    def insert(self, hits: Hits, pose: SE2) -> None:
        """Add hits of a frame at a pose."""
        if not len(hits.points):
            return
        there = (*pose,)
        used = insert_hits(self._arrays, self._used, hits.points, hits.normals, there)
        if used < 0:
            self._grow_to_contain(hits.placed(pose).points)
            used = insert_hits(self._arrays, self._used, hits.points, hits.normals, there)
        self._used = used
        if CELLS * used > self.slots:
            self._make_room(CELLS * used)
            insert_hits(self._arrays, used, hits.points, hits.normals, there)

    def _fill(self, hits: Hits) -> None:
        """Add the first hits, in the map's frame: in half the time of `insert`, which finds too little room twice."""
        self._grow_to_contain(hits.points)
        tiles, _, _, lattice, _ = self._arrays
        cells, offsets = cells_of(hits.points, hits.normals, (0.0, 0.0, 0.0), lattice)
        self._used = claim_tiles(tiles, self._used, cells)
        self._make_room(CELLS * self._used)
        add_hits(self._arrays, cells, offsets)

    def place(
        self, scan: LaserScan, max_range: float, prior: PosePrior, T_robot_sensor: SE2, search: Search, hits: FloatArray
    ) -> tuple[Registration, int]:
        """Lay a scan onto the surfaces; return where it lies, and how many hits it has.

        Parameters
        ----------
        scan, max_range
            The scan, and the range up to which its hits count [m].
        prior
            Where the robot probably was.
        T_robot_sensor
            Pose of the laser on the robot.
        search
            See `tbmslam.kernels.surfels.surfel_alignment.align`.
        hits
            (2, N, 2), written to: the hits [m] and their normals, in the scan's frame.
        """
        # Plain tuples come in in a third of the time of named ones.
        beams = scan.angle_min, scan.angle_increment, (*scan.beam_step,), max_range
        start, mean, mount = (*prior.start,), (*prior.mean,), (*T_robot_sensor,)
        hessian = np.empty((3, 3))
        (x, y, theta, matched, independent, surprise), count = place_scan(
            self._arrays, scan.ranges, beams, start, mean, prior.deviations, mount, search, hits, hessian
        )
        return Registration(SE2(x, y, theta), hessian, matched, independent, surprise), count

    def register(
        self,
        hits: Hits,
        start: SE2,
        mean: SE2,
        information: FloatArray,
        search: Search,
        known: Pose = NOWHERE,
    ) -> Registration:
        """Lay hits onto the surfaces.

        Parameters
        ----------
        hits
            Hits in the scan's frame, in the order of the beams.
        start
            Where the scan's frame is thought to lie.
        mean, information
            The prior's mean, and its inverse scale (3, 3); what the surfaces leave open keeps to the mean.
        search
            See `tbmslam.kernels.surfels.surfel_alignment.align`.
        known
            Where another registration of the hits lies: where this one comes to it, it ends there with a share of -1.
        """
        hessian = np.empty((3, 3))
        x, y, theta, *fit = align(
            self._arrays, hits.points, hits.normals, (*start,), (*mean,), information, search, (*known,), hessian
        )
        return Registration(SE2(x, y, theta), hessian, *fit)

    def strays(self, hits: Hits, pose: SE2, span: float, tolerance: float) -> float:
        """Return how many hits lie on no known surface, where all within some length [m] count as one.

        At the tolerance [standard deviations] from a surface a hit counts half.
        """
        return float(strays(self._arrays, hits.points, hits.normals, (*pose,), span, tolerance))

    def search(
        self, hits: Hits, guess: SE2, reach: int, turns: FloatArray, tolerance: float, costs: tuple[float, float]
    ) -> SE2:
        """Return the pose that matches best among all shifts by up to `reach` cells and all turns about a guess.

        Parameters
        ----------
        turns
            The turns (K,) [rad].
        tolerance
            Distance at which a hit counts half [standard deviations].
        costs
            Share of all hits that a metre and a radian away from the guess must win.
        """
        return SE2(*search(self._arrays, hits.points, hits.normals, (*guess,), reach, turns, tolerance, costs))

    def _make_room(self, slots: int) -> None:
        """Have room for that many slots."""
        have = self.slots
        more = 2 * slots if self._spare else slots
        moments, fits = (np.zeros((more, width), dtype=np.float32) for width in (6, 8))
        moments[:have], fits[:have] = self._surfels.moments, self._surfels.fits
        self._surfels = self._surfels._replace(moments=moments, fits=fits)
        self._arrays = _plain(self._surfels)

    def _grow_to_contain(self, points: FloatArray) -> None:
        (resolution, first_row, first_col), (_, tile_rows, tile_cols) = self._surfels.lattice, self._surfels.tiles.shape
        left, right, bottom, top = extent(points)
        low_row, low_col = math.floor(bottom / resolution) - 2, math.floor(left / resolution) - 2
        high_row, high_col = math.floor(top / resolution) + 3, math.floor(right / resolution) + 3
        last_row, last_col = first_row + SIDE * tile_rows, first_col + SIDE * tile_cols
        if first_row <= low_row and high_row <= last_row and first_col <= low_col and high_col <= last_col:
            return
        spare = self._spare
        low_row, low_col = SIDE * (low_row // SIDE) - spare, SIDE * (low_col // SIDE) - spare
        high_row, high_col = -SIDE * (-high_row // SIDE) + spare, -SIDE * (-high_col // SIDE) + spare
        if tile_rows:
            low_row, high_row = min(low_row, first_row), max(high_row, last_row)
            low_col, high_col = min(low_col, first_col), max(high_col, last_col)
        tiles = np.zeros((2, (high_row - low_row) // SIDE, (high_col - low_col) // SIDE), dtype=np.int32)
        row, col = (first_row - low_row) // SIDE, (first_col - low_col) // SIDE
        tiles[:, row : row + tile_rows, col : col + tile_cols] = self._surfels.tiles
        self._surfels = self._surfels._replace(tiles=tiles, lattice=Lattice(resolution, low_row, low_col))
        self._arrays = _plain(self._surfels)


def _plain(surfels: Surfels) -> SurfelArrays:
    """Return surfels as plain tuples."""
    tiles, moments, fits, lattice, limits = surfels
    return tiles, moments, fits, (*lattice,), limits
