"""A map in tiles: squares of its grid that are looked at one by one, as if each were a map."""

import math
from itertools import pairwise

import numpy as np

from merging.config.registration import StructureConfig
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import TbmGrid

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


def middle_of(structure: WallMap) -> np.ndarray:
    """Return the middle (2,) of the walls [m]."""
    return np.asarray(structure.points.mean(axis=0))


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
