"""A map of surface elements that a scan is laid onto below the size of a cell.

Each cell keeps the moments of the hits in it; a surfel is their mean and spread over the cell and its neighbours, so a
wall is a line with a position and a normal rather than a row of cells. After the normal distributions transform (Biber
and Strasser 2003) with the point-to-line metric (Censi 2008): along a wall the surfel says nothing.
"""

import math
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from tbmslam.kernels.lattice import Lattice
from tbmslam.kernels.surfels import SlotIndex, SurfelArray, add_hits, align, renew_all, search
from tbmslam.se2 import SE2, FloatArray


class SurfelConfig(BaseModel):
    """What makes a surface element."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    resolution: float = Field(0.1, gt=0, description="side of a cell; an element gathers three by three [m]")
    noise: float = Field(0.02, gt=0, description="standard deviation of a hit around its wall [m]")
    point_size: float = Field(0.03, ge=0, description="up to this spread an element is a point, not a line [m]")
    clutter: float = Field(0.05, gt=0, description="thickness at which an element counts half [m]")
    certain_hits: float = Field(8.0, gt=0, description="hits from which on an element counts fully")


@dataclass(frozen=True)
class Registration:
    """How a scan fits a surfel map.

    Parameters
    ----------
    pose
        Where the scan's frame lies in the map's.
    hessian
        Curvature (3, 3) of the cost in x, y [1/m^2] and theta there, without the prior.
    matched
        Share of the points' weight that lies on surfaces, in [0, 1].
    cost
        Robust sum of squared distances in standard deviations.
    """

    pose: SE2
    hessian: FloatArray
    matched: float
    cost: float


class SurfelMap:
    """Surfels on a lattice that grows with what is inserted; only cells near walls take memory."""

    GROWTH_CELLS = 64

    def __init__(self, config: SurfelConfig) -> None:
        self._config = config
        self._limits = (config.noise, config.point_size, config.clutter, config.certain_hits)
        self._lattice = Lattice(config.resolution, 0, 0)
        self._index: SlotIndex = np.zeros((2, 0, 0), dtype=np.int32)
        self._moments: SurfelArray = np.zeros((0, 6), dtype=np.float32)
        self._surfels: SurfelArray = np.zeros((1, 6), dtype=np.float32)
        self._used = 1

    def insert(self, points: FloatArray, normals: FloatArray, *, renew: bool = True) -> None:
        """Add hits (N, 2) [m] and the normals (N, 2) of what they hit, towards the laser, in the map's frame.

        Without `renew` the surfaces show them only after `freeze`, which is quicker where many scans come first.
        """
        if len(points) == 0:
            return
        self._grow_to_contain(points)
        self._make_room(9 * len(points))
        self._used = add_hits(
            self._index,
            self._moments,
            self._surfels,
            self._used,
            self._lattice,
            points,
            normals,
            self._limits,
            renew,
        )

    def freeze(self) -> None:
        """Fit all surfaces and give back the memory that only inserting needs; nothing can be inserted afterwards."""
        renew_all(self._index, self._moments, self._surfels, self._lattice, self._limits)
        self._moments = self._moments[:0]
        self._surfels = self._surfels[: self._used].copy()

    def register(
        self,
        points: FloatArray,
        normals: FloatArray,
        weights: FloatArray,
        guess: SE2,
        prior: FloatArray,
        tolerances: FloatArray,
        iterations: int,
    ) -> Registration:
        """Lay points onto the surfaces.

        Parameters
        ----------
        points
            Hits (N, 2) in the scan's frame [m].
        normals
            Normals (N, 2) of the surfaces hit, towards the laser, in the scan's frame.
        weights
            Their weights (N,).
        guess
            Where the scan's frame is thought to lie.
        prior
            Information (3, 3) of the guess; what the surfaces leave open keeps to it.
        tolerances
            Distances beyond which a point loses its say [standard deviations], from wide to narrow.
        iterations
            Gauss-Newton steps for each tolerance, at the most.
        """
        pose, hessian, matched, cost = align(
            self._index,
            self._surfels,
            self._lattice,
            points,
            normals,
            weights,
            guess,
            prior,
            tolerances,
            iterations,
        )
        return Registration(SE2(*pose), hessian, matched, cost)

    def search(
        self,
        points: FloatArray,
        normals: FloatArray,
        guess: SE2,
        shifts: FloatArray,
        turns: FloatArray,
        tolerance: float,
        costs: tuple[float, float],
    ) -> SE2:
        """Return the pose among all `shifts` (M, 2) [m] and `turns` (K,) [rad] about a guess that matches best.

        Parameters
        ----------
        tolerance
            Distance at which a point counts half [standard deviations].
        costs
            Share of all points that a metre and a radian away from the guess must win.
        """
        return SE2(
            *search(self._index, self._surfels, self._lattice, points, normals, guess, shifts, turns, tolerance, costs)
        )

    def _make_room(self, slots: int) -> None:
        """Have room for that many more slots."""
        need = self._used + slots
        if need > len(self._moments):
            more = max(need, 2 * len(self._moments)) - len(self._moments)
            self._moments = np.concatenate((self._moments, np.zeros((more, 6), dtype=np.float32)))
            self._surfels = np.concatenate(
                (self._surfels, np.zeros((len(self._moments) - len(self._surfels), 6), np.float32))
            )

    def _grow_to_contain(self, points: FloatArray) -> None:
        (resolution, first_row, first_col), (_, rows, cols) = self._lattice, self._index.shape
        low, high = points.min(axis=0) / resolution, points.max(axis=0) / resolution
        need = (math.floor(low[1]) - 2, math.floor(high[1]) + 3, math.floor(low[0]) - 2, math.floor(high[0]) + 3)
        have = (first_row, first_row + rows, first_col, first_col + cols)
        if rows and have[0] <= need[0] and have[1] >= need[1] and have[2] <= need[2] and have[3] >= need[3]:
            return
        spare = self.GROWTH_CELLS
        top, bottom, left, right = need[0] - spare, need[1] + spare, need[2] - spare, need[3] + spare
        if rows:
            top, bottom, left, right = min(top, have[0]), max(bottom, have[1]), min(left, have[2]), max(right, have[3])
        index = np.zeros((2, bottom - top, right - left), dtype=np.int32)
        if rows:
            index[:, have[0] - top : have[1] - top, have[2] - left : have[3] - left] = self._index
        self._index, self._lattice = index, Lattice(resolution, top, left)
