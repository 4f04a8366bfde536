"""A map of surfels, to which scans are registered with an accuracy below the size of a cell.

Each cell stores the moments of its hits. A surfel is their mean and spread over the cell and its neighbours, so a wall
is a line with a position and a normal instead of a row of cells. This is the normal distributions transform (Biber and
Strasser 2003) with the point-to-line metric (Censi 2008): a surfel does not constrain a pose along its wall.
"""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels import Pose
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.surfels.known_hits import count_known_hits
from tbmslam.kernels.surfels.outline import Outline
from tbmslam.kernels.surfels.surfel_alignment import NOWHERE, Search, align, place_scan
from tbmslam.kernels.surfels.surfel_search import search
from tbmslam.kernels.surfels.surfels import (
    CELLS,
    SIDE,
    SurfelArrays,
    Surfels,
    extent,
    insert_hits,
)
from tbmslam.sensing.laser_scan import Hits, LaserScan
from tbmslam.tracking.tracker import PosePrior


class SurfelConfig(FrozenConfig):
    """The parameters of surfels."""

    resolution: float = Field(0.1, gt=0, description="side of a cell; a surfel gathers three by three [m]")
    noise: float = Field(
        0.01, gt=0, description="standard deviation of a hit beside the spread of those that made its surfel [m]"
    )
    point_size: float = Field(0.03, ge=0, description="up to this spread a surfel is a point, not a line [m]")
    clutter: float = Field(0.05, gt=0, description="thickness at which a surfel counts half [m]")
    certain_hits: float = Field(8.0, gt=0, description="hits from which on a surfel counts fully")


class Registration(NamedTuple):
    """The registration of a scan to a surfel map."""

    pose: SE2
    """Pose of the scan in the map's frame."""
    hessian: FloatArray
    """Curvature (3, 3) of the cost in x, y [1/m^2] and theta, without the prior."""
    matched: float
    """Share of the hits on surfaces, in [0, 1]."""
    independent: float
    """Number of independent hits of the scan."""
    surprise: float
    """Squared Mahalanobis distance of the pose from the prior's mean."""


class SurfelMap:
    """Surfels on a growing lattice; only cells near walls take memory.

    The lattice grows by `spare` more than needed, so that it grows rarely [m]; 0 for hits that are all known. `slots`
    is the initial number of cells with memory.
    """

    def __init__(self, config: SurfelConfig, spare: float = 6.4, slots: int = CELLS) -> None:
        self._spare = SIDE * round(spare / config.resolution / SIDE)
        limits = (config.noise, config.point_size, config.clutter, config.certain_hits)
        # `insert_hits` clears the tiles that it needs; all memory of a map that replaces another takes longer.
        moments, fits = (np.empty((slots, width), dtype=np.float32) for width in (6, 8))
        moments[:CELLS], fits[:CELLS] = 0.0, 0.0
        self._surfels = Surfels(
            tiles=np.zeros((2, 0, 0), dtype=np.int32),
            moments=moments,
            fits=fits,
            lattice=Lattice(config.resolution, 0, 0),
            limits=limits,
        )
        self._arrays = _plain(self._surfels)
        self._used = 1

    @classmethod
    def of(cls, hits: Hits, config: SurfelConfig) -> "SurfelMap":
        """Return the surfels of hits in the map's frame, without spare memory."""
        surfaces = cls(config, spare=0.0)
        if len(hits.points):
            surfaces._grow_to_contain(hits.points)  # else the memory is enlarged twice
            surfaces.insert(hits, SE2.identity())
        return surfaces

    @property
    def slots(self) -> int:
        """Number of cells with memory."""
        return len(self._surfels.moments)

    def insert(self, hits: Hits, pose: SE2) -> None:
        """Add hits of a frame at a pose."""
        if not len(hits.points):
            return
        there = (*pose,)
        used = insert_hits(self._arrays, self._used, hits.points, hits.normals, there)
        if used < 0:
            self._grow_to_contain(pose.apply(hits.points))
            used = insert_hits(self._arrays, self._used, hits.points, hits.normals, there)
        self._used = used
        if CELLS * used > self.slots:
            self._make_room(CELLS * used)
            insert_hits(self._arrays, used, hits.points, hits.normals, there)

    def place(
        self, scan: LaserScan, max_range: float, prior: PosePrior, T_robot_sensor: SE2, search: Search, hits: FloatArray
    ) -> tuple[Registration, int]:
        """Register a scan to the surfels; return its registration and the number of its hits up to `max_range` [m].

        For `search` see `tbmslam.kernels.surfels.surfel_alignment.align`. `hits` (2, N, 2) receives the hits [m] and
        their normals in the scan's frame.
        """
        # Plain tuples are passed in a third of the time of named tuples.
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
        """Register hits in the scan's frame, in the order of the beams, to the surfels.

        `start` is the initial pose. `mean` and `information` (3, 3) are the prior's mean and inverse scale. For
        `search` see `tbmslam.kernels.surfels.surfel_alignment.align`. If the registration comes near the `known` result
        of another one, it ends there with a share of -1.
        """
        hessian = np.empty((3, 3))
        x, y, theta, *fit = align(
            self._arrays, hits.points, hits.normals, (*start,), (*mean,), information, search, (*known,), hessian
        )
        return Registration(SE2(x, y, theta), hessian, *fit)

    def known_hits(self, hits: Hits, pose: SE2, span: float, tolerance: float, outline: Outline) -> tuple[float, float]:
        """Return the numbers of hits on surfels or the outline of a keyframe, and on neither.

        Hits within a length `span` of surface count as one [m]. A hit at the distance `tolerance` from a surface counts
        half [standard deviations].
        """
        return count_known_hits(self._arrays, hits.points, hits.normals, (*pose,), span, tolerance, outline)

    def search(
        self, hits: Hits, guess: SE2, reach: int, turns: FloatArray, tolerance: float, costs: tuple[float, float]
    ) -> SE2:
        """Return the best pose among all shifts by up to `reach` cells and all turns (K,) about a guess [rad].

        A hit at the distance `tolerance` counts half [standard deviations]. `costs` are the shares of all hits that a
        pose must gain for a metre and for a radian away from the guess.
        """
        return SE2(*search(self._arrays, hits.points, hits.normals, (*guess,), reach, turns, tolerance, costs))

    def _make_room(self, slots: int) -> None:
        """Allocate at least that many slots."""
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
