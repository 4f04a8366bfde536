import numpy as np
import pytest

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion.warping import warp
from merging.scoring.decoys import find_decoys, mirror_image, mirrored
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2

CONFIG = MergeConfig()


def structure(grid):
    return WallMap.from_grid(grid, StructureConfig())


def test_a_mirror_image_is_what_the_mirrored_grid_looks_like(rooms):
    grid = rooms(1)
    seen, expected = mirror_image(structure(grid)), structure(mirrored(grid))
    assert seen.geometry == expected.geometry
    np.testing.assert_array_equal(seen.free, expected.free)
    np.testing.assert_allclose(seen.distances_m, expected.distances_m, atol=1e-6)
    order, other = np.lexsort(seen.points.T.round(6)), np.lexsort(expected.points.T.round(6))
    np.testing.assert_allclose(seen.points[order], expected.points[other], atol=1e-9)
    np.testing.assert_allclose(seen.weights[order], expected.weights[other])
    sure = ~seen.two_sided[order]
    np.testing.assert_allclose(seen.normals[order][sure], expected.normals[other][sure], atol=1e-6)


def test_a_mirror_image_knows_its_nearest_walls(rooms):
    seen = mirror_image(structure(rooms(2)))
    rows, cols = seen.geometry.rows // 2, seen.geometry.cols // 3
    x, y = seen.geometry.centre_of(float(rows), float(cols))
    nearest = seen.points[seen.nearest[rows, cols]]
    assert np.hypot(*(nearest - (x, y))) == pytest.approx(float(seen.distances_m[rows, cols]), abs=0.1)


def test_twice_mirrored_is_the_map_itself(rooms):
    once = structure(rooms(1))
    twice = mirror_image(mirror_image(once))
    assert twice.geometry.origin_x == pytest.approx(once.geometry.origin_x)
    np.testing.assert_array_equal(twice.points, once.points)
    np.testing.assert_array_equal(twice.nearest, once.nearest)


def test_the_mirror_image_of_a_mirrored_building_fits(rooms):
    grid = rooms(1)
    other = warp(grid, SE2(2.0, -1.0, 0.4), grid.geometry)
    stranger = structure(mirrored(other))
    alike = max(decoy.agreed_wall_m for decoy in find_decoys(structure(grid), stranger, CONFIG))
    chance = max(decoy.agreed_wall_m for decoy in find_decoys(structure(grid), structure(other), CONFIG))
    assert alike > 2.0 * chance
