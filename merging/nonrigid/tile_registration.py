"""Registration of a map in square tiles, each of which is registered rigidly by itself."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.nonrigid.deformation import Deformation
from merging.registration.hypotheses import refine_all
from merging.verification.evidence import examine
from merging.walls import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2

_LEAST_WALL = 0.5
"""Tiles with less wall than this share of the requested side are not used: they do not fix a pose."""


def tiles_of(grid: TbmGrid, side_m: float, most: int, config: StructureConfig) -> list[WallMap]:
    """Cut the known part of a grid into tiles of one size, and leave out tiles with little wall.

    Parameters
    ----------
    side_m
        Longest side of a tile [m]; it is increased where there would be too many tiles.
    most
        The largest number of tiles.
    config
        The parameters that define walls.
    """
    known = grid.cropped_to_known()
    rows, cols = known.masses.shape[:2]
    side = side_m / known.geometry.resolution
    while math.ceil(rows / side) * math.ceil(cols / side) > most:
        side *= 1.1
    cut = [_cut_out(known, row, col) for row in pairwise(_cuts(rows, side)) for col in pairwise(_cuts(cols, side))]
    tiles = [WallMap.from_grid(part, config) for part in cut if part.is_known().any()]
    return [tile for tile in tiles if tile.wall_m >= _LEAST_WALL * side_m]


def _cuts(size: int, side: float) -> list[int]:
    """Return the bounds of equal parts of a row of cells, each at most a side long."""
    count = max(math.ceil(size / side), 1)
    return [round(size * index / count) for index in range(count + 1)]


def _cut_out(grid: TbmGrid, rows: tuple[int, int], cols: tuple[int, int]) -> TbmGrid:
    g = grid.geometry
    geometry = g._replace(
        origin_x=g.origin_x + cols[0] * g.resolution,
        origin_y=g.origin_y + rows[0] * g.resolution,
        rows=rows[1] - rows[0],
        cols=cols[1] - cols[0],
    )
    return TbmGrid(geometry, np.ascontiguousarray(grid.masses[slice(*rows), slice(*cols)]))


@dataclass(frozen=True)
class DeformableMap:
    """A map that may be deformed."""

    grid: TbmGrid
    """Its cells."""
    structure: WallMap
    """Its walls and free space."""
    config: MergeConfig
    """The parameters, with the size of the tiles."""

    @classmethod
    def of(cls, grid: TbmGrid, config: MergeConfig, structure: WallMap | None = None) -> "DeformableMap":
        """Return a deformable map of a grid; its structure is computed unless it is given."""
        return cls(grid, structure or WallMap.from_grid(grid, config.structure), config)

    @cached_property
    def rounds(self) -> Sequence[Sequence[WallMap]]:
        """The tiles of each round of registration, large ones first."""
        settings, structure = self.config.nonrigid, self.config.structure
        large = tiles_of(self.grid, settings.side_m, settings.most, structure)
        small = tiles_of(self.grid, settings.side_m / 2.0, 4 * settings.most, structure)
        return (large, small, small) if len(large) > 1 else (small, small)


@dataclass(frozen=True)
class DeformedMap:
    """A map that was deformed to fit another map."""

    deformation: Deformation
    """The deformation."""
    motion: SE2
    """The rigid T_target_source nearest to it, which aligns the deformed map."""
    residual_m: float
    residual_rad: float
    """RMS differences between the tiles' transforms and `motion` [m], [rad]."""
    grid: TbmGrid
    """The deformed map in its own frame."""


def deform(target: WallMap, source: DeformableMap, start: SE2, config: MergeConfig) -> DeformedMap | None:
    """Deform a source map to fit a target map near an initial pose; None if fewer than two of its tiles fit."""
    deformation = Deformation.of_rigid(start)
    for tiles in source.rounds:
        fitting = _registered_tiles(target, tiles, deformation, config)
        if len(fitting) < 2:
            return None
        deformation = Deformation.of_tiles([tile for tile, _ in fitting], [motion for _, motion in fitting])
    motion, residual_m, residual_rad = deformation.nearest_rigid()
    return DeformedMap(deformation, motion, residual_m, residual_rad, deformation.deformed(source.grid, motion))


def _registered_tiles(
    target: WallMap, tiles: Sequence[WallMap], initial: Deformation, config: MergeConfig
) -> list[tuple[WallMap, SE2]]:
    """Refine each tile from its initial pose; return the tiles that fit near it, with their T_target_source."""
    settings, fitting = config.nonrigid, list[tuple[WallMap, SE2]]()
    for tile in tiles:
        start = initial.motion_at(tile.centroid)
        motion = refine_all(target, tile, [start], config)[0]
        found = examine(target, tile, motion, config.verification)
        fits = found.agreement >= settings.min_agreement and found.agreed_wall_m >= settings.min_wall_m
        if fits and math.dist(motion.apply(tile.centroid), start.apply(tile.centroid)) <= settings.farthest_m:
            fitting.append((tile, motion))
    return fitting
