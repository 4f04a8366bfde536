"""A map in tiles: squares of its grid that are looked at one by one, as if each were a map."""

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
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2

_LEAST_WALL = 0.5
"""Tiles with less wall than this share of the side that was asked for say nothing."""


def tiles_of(grid: TbmGrid, side_m: float, most: int, config: StructureConfig) -> list[WallMap]:
    """Cut what is known of a grid into tiles of one size; those of hardly any wall are left out.

    Parameters
    ----------
    grid
        The map.
    side_m
        Longest side of a tile [m], but where there would be too many.
    most
        So many tiles at the most.
    config
        What is wall.
    """
    known = grid.cropped_to_known()
    rows, cols = known.masses.shape[:2]
    side = side_m / known.geometry.resolution
    while math.ceil(rows / side) * math.ceil(cols / side) > most:
        side *= 1.1
    cut = [_cut_out(known, row, col) for row in pairwise(_cuts(rows, side)) for col in pairwise(_cuts(cols, side))]
    tiles = [WallMap.from_grid(one, config) for one in cut if one.is_known().any()]
    return [one for one in tiles if one.wall_m >= _LEAST_WALL * side_m]


def _cuts(size: int, side: float) -> list[int]:
    """Return where so many cells in a row are cut into equal pieces, none longer than a tile's side."""
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
    """A map that may be bent.

    Parameters
    ----------
    grid
        Its cells.
    structure
        Their walls and free space.
    config
        Into which tiles it is cut.
    """

    grid: TbmGrid
    structure: WallMap
    config: MergeConfig

    @classmethod
    def of(cls, grid: TbmGrid, config: MergeConfig, structure: WallMap | None = None) -> "DeformableMap":
        """Find the structure of a grid where it is not given."""
        return cls(grid, structure or WallMap.from_grid(grid, config.structure), config)

    @cached_property
    def rounds(self) -> Sequence[Sequence[WallMap]]:
        """The tiles that slide, round after round."""
        how, structure = self.config.nonrigid, self.config.structure
        large = tiles_of(self.grid, how.side_m, how.most, structure)
        small = tiles_of(self.grid, how.side_m / 2.0, 4 * how.most, structure)
        return (large, small, small) if len(large) > 1 else (small, small)


@dataclass(frozen=True)
class DeformedMap:
    """A map that was bent.

    Parameters
    ----------
    bend
        Where its points belong.
    motion
        The rigid T_target_source nearest to that, which lays the bent map there.
    apart_m, apart_rad
        How far its tiles lie from where that alone would lay them, root mean squares [m], [rad].
    grid
        The bent map, in its own frame.
    """

    bend: Deformation
    motion: SE2
    apart_m: float
    apart_rad: float
    grid: TbmGrid


def deform(target: WallMap, source: DeformableMap, start: SE2, config: MergeConfig) -> DeformedMap | None:
    """Deform a map so that it fits another near where it is thought to lie; None where hardly any of it fits.

    Parameters
    ----------
    target
        The other map.
    source
        The map.
    start
        T_target_source, roughly.
    config
        How tiles slide.
    """
    bend = Deformation.none(start)
    for tiles in source.rounds:
        laid = _slid(target, tiles, bend, config)
        if len(laid) < 2:
            return None
        bend = Deformation.of([tile for tile, _ in laid], [motion for _, motion in laid])
    motion, apart_m, apart_rad = bend.rigid()
    return DeformedMap(bend, motion, apart_m, apart_rad, bend.straightened(source.grid, motion))


def _slid(
    target: WallMap, tiles: Sequence[WallMap], bend: Deformation, config: MergeConfig
) -> list[tuple[WallMap, SE2]]:
    """Let tiles slide from where a bent map has them; return those that fit near there, and where."""
    how, laid = config.nonrigid, list[tuple[WallMap, SE2]]()
    for tile in tiles:
        start = bend.motion_at(tile.centroid)
        motion = refine_all(target, tile, [start], config)[0]
        found = examine(target, tile, motion, config.verification)
        fits = found.agreement >= how.min_agreement and found.agreed_wall_m >= how.min_wall_m
        if fits and math.dist(motion.apply(tile.centroid), start.apply(tile.centroid)) <= how.farthest_m:
            laid.append((tile, motion))
    return laid
