"""Hits on the walls of a room, and the surfels that they make."""

import numpy as np

from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.surfels.surfels import CELLS, Surfels, add_hits, cells_of, claim_tiles

RESOLUTION = 0.1
LIMITS = (0.02, 0.03, 0.05, 8.0)
LATTICE = Lattice(RESOLUTION, -60, -60)


def room_walls(generator, count=3000):
    """Hits on the four walls of a 6 m x 4 m room and on a thin post, with 1 cm noise."""
    side = generator.integers(0, 4, count)
    t = generator.uniform(-1.0, 1.0, count)
    x = np.select([side == 0, side == 1], [3.0, -3.0], 3.0 * t)
    y = np.select([side == 2, side == 3], [2.0, -2.0], 2.0 * t)
    post = np.array([1.0, 0.5]) + generator.normal(0.0, 0.005, (50, 2))
    return np.vstack((np.column_stack((x, y)) + generator.normal(0.0, 0.01, (count, 2)), post))


def facing_origin(points):
    """Normals of surfaces that all face a laser at the origin."""
    return -points / np.maximum(np.hypot(*points.T), 1e-9)[:, None]


def inserted(surfels, used, points, normals):
    """Insert hits in the map's frame, and return how many tiles are in use then."""
    cells, offsets = cells_of(points, normals, (0.0, 0.0, 0.0), LATTICE)
    used = claim_tiles(surfels.tiles, used, cells)
    add_hits(surfels, cells, offsets)
    return used


def surfels_of(points, normals=None):
    """Return a surfel map's arrays with points inserted in several parts."""
    normals = facing_origin(points) if normals is None else normals
    surfels = Surfels(
        tiles=np.zeros((2, 30, 30), dtype=np.int32),
        moments=np.zeros((CELLS * (2 * 30 * 30 + 1), 6), dtype=np.float32),
        fits=np.zeros((CELLS * (2 * 30 * 30 + 1), 8), dtype=np.float32),
        lattice=LATTICE,
        limits=LIMITS,
    )
    used = 1
    for part in np.array_split(np.arange(len(points)), 7):
        used = inserted(surfels, used, points[part], normals[part])
    assert used == surfels.tiles.max() + 1
    assert not surfels.moments[:CELLS].any()
    assert not surfels.fits[:CELLS].any()
    return surfels
