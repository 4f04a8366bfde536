import itertools
import math

import numpy as np
import pytest

from tbmslam.kernels.surfels.surfel_search import _bounds, search
from tbmslam.kernels.surfels.surfels import layer_of, slot_of
from tests import reference
from tests.tbmslam.kernels.surfels.surfel_rooms import RESOLUTION, facing_origin, room_walls, surfels_of


def test_search_is_trying_every_pose():
    generator = np.random.default_rng(6)
    surfels = surfels_of(room_walls(generator))
    turns = np.arange(-0.3, 0.31, 0.1)
    scan = room_walls(generator, 60)
    normals, guess, costs = facing_origin(scan), (0.213, -0.134, 0.151), (0.2, 0.05)
    found = search(surfels, scan, normals, guess, 3, turns, 8.0, costs)
    scores = {}
    for turn, row, col in itertools.product(turns, range(-3, 4), range(-3, 4)):
        pose = (guess[0] + col * RESOLUTION, guess[1] + row * RESOLUTION, guess[2] + turn)
        away = costs[0] * RESOLUTION * math.hypot(row, col) + costs[1] * abs(turn)
        scores[pose] = reference.matched_share(surfels, scan, normals, pose, 8.0) - away
    assert found == pytest.approx(max(scores, key=scores.get))


def test_search_finds_a_far_place():
    generator = np.random.default_rng(6)
    surfels = surfels_of(room_walls(generator))
    turns = np.arange(-1.0, 1.01, 0.03)
    scan = room_walls(generator, 150)
    found = search(surfels, scan, facing_origin(scan), (0.4, -0.3, 0.75), 5, turns, 8.0, (0.0, 0.0))
    assert found == pytest.approx((0.0, 0.0, 0.0), abs=0.09)


def test_search_takes_the_nearest_of_equals():
    generator = np.random.default_rng(7)
    wall = np.column_stack((generator.uniform(-5.0, 5.0, 3000), generator.normal(0.0, 0.01, 3000)))
    scan = wall[np.abs(wall[:, 0]) < 2.0][:150]
    normals = np.full((len(scan), 2), 1.0)
    surfels = surfels_of(wall, np.full((len(wall), 2), 1.0))
    near = search(surfels, scan, normals, (0.05, 0.0, 0.0), 10, np.zeros(1), 8.0, (0.2, 0.0))
    assert near[0] == pytest.approx(0.05)


def test_bounds_count_the_points_in_cells_that_may_have_a_surface():
    """Also of points beyond the lattice, which lie in none."""
    generator = np.random.default_rng(13)
    surfels = surfels_of(room_walls(generator, 2000))
    points = np.vstack((room_walls(generator, 80), generator.uniform(-14.0, 14.0, (200, 2))))
    normals, guess, reach, turns = facing_origin(points), (0.3, -0.2, 0.1), 3, np.array([-0.4, 0.0, 1.3])
    bounds = _bounds(surfels, points, normals, guess, reach, turns)
    for k, row, col in itertools.product(range(3), range(2 * reach + 1), range(2 * reach + 1)):
        c, s = math.cos(guess[2] + turns[k]), math.sin(guess[2] + turns[k])
        turn = np.array([[c, -s], [s, c]])
        cells = np.floor((points @ turn.T + guess[:2]) / RESOLUTION).astype(int) + 60 + (col - reach, row - reach)
        layers = [layer_of(*normal) for normal in normals @ turn.T]
        slots = [
            slot_of(surfels.tiles, layer, y, x) if 0 <= x < 120 and 0 <= y < 120 else 0
            for layer, (x, y) in zip(layers, cells.tolist(), strict=True)
        ]
        assert bounds[k, row, col] == np.count_nonzero(surfels.fits[slots, 5])
