import math
from typing import get_args

import numpy as np
import pytest

from merging.config.registration import Descriptor, FeatureConfig
from merging.fusion import warp
from merging.registration.features import Channels, Features, describe, describe_all, flipped, match
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

GEOMETRY = GridGeometry(0.1, 2.0, -1.0, 2, 3)


def grid():
    masses = np.zeros((2, 3, 4), dtype=np.float32)
    masses[0] = [(0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]
    masses[1] = [(0, 0.6, 0.25, 0.15), (0.5, 0.5, 0, 0), (1, 0, 0, 0)]
    return TbmGrid(GEOMETRY, masses)


def test_each_image_shows_its_mass_with_the_largest_y_on_top():
    channels = Channels.from_grid(grid())
    np.testing.assert_array_equal(channels.pignistic, [[172, 255, 128], [255, 0, 128]])
    np.testing.assert_array_equal(channels.occupied, [[64, 0, 0], [0, 255, 0]])
    np.testing.assert_array_equal(channels.free, [[153, 255, 0], [255, 0, 0]])
    np.testing.assert_array_equal(channels.unknown, [[38, 0, 255], [0, 0, 255]])


def test_a_border_is_unknown_and_moves_no_cell():
    plain, bordered = Channels.from_grid(grid()), Channels.from_grid(grid(), border=4)
    for name, outside in (("pignistic", 128), ("occupied", 0), ("free", 0), ("unknown", 255)):
        image = getattr(bordered, name)
        np.testing.assert_array_equal(image[4:-4, 4:-4], getattr(plain, name))
        assert np.all(image[:4] == outside)
    np.testing.assert_allclose(bordered.to_metres([(4, 5)]), plain.to_metres([(0, 1)]))


def test_pixels_lie_where_their_cells_lie():
    channels = Channels.from_grid(grid())
    rows, cols = np.nonzero(channels.occupied == 255)  # the occupied cell is row 0, column 1
    np.testing.assert_allclose(channels.to_metres(np.column_stack((cols, rows))), [GEOMETRY.centre_of(0, 1)])
    np.testing.assert_allclose(channels.to_metres((0, 0)), [GEOMETRY.centre_of(1, 0)])


def test_flipping_twice_is_nothing():
    cells = np.arange(6).reshape(3, 2)
    np.testing.assert_array_equal(flipped(cells)[0], cells[2])
    np.testing.assert_array_equal(flipped(flipped(cells)), cells)


CONFIG = FeatureConfig()


@pytest.mark.parametrize("descriptor", ["concatenated", "or", "xor", "pignistic"])  # not `and`: see below
def test_a_map_matches_itself_turned_and_shifted(rooms, descriptor):
    config = FeatureConfig(descriptor=descriptor)
    target, motion = rooms(1), SE2(3.7, -12.2, math.radians(25.0))
    matches = match(describe(target, config), describe(warp(target, motion, target.geometry), config), config)
    moved = motion.apply(matches.target_points)
    right = np.linalg.norm(moved - matches.source_points, axis=1) < 0.2
    assert right.sum() >= 20


def test_only_the_concatenated_descriptor_is_three_times_as_long(rooms):
    lengths = {
        kind: describe(rooms(1), FeatureConfig(descriptor=kind)).descriptors.shape[1] for kind in get_args(Descriptor)
    }
    assert lengths == {"concatenated": 96, "and": 32, "or": 32, "xor": 32, "pignistic": 32}


def test_where_everything_is_known_the_and_of_the_descriptors_is_empty(rooms):
    # The unknown image is blank there, so its descriptor has no bit set; the paper's table II finds `and` weak too.
    assert not describe(rooms(1), FeatureConfig(descriptor="and")).descriptors.any()


@pytest.mark.parametrize("kind", get_args(Descriptor))
def test_side_by_side_grids_are_described_as_alone(rooms, kind):
    config = FeatureConfig(descriptor=kind)
    grids = [rooms(1), TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 40, 30)), rooms(2)]
    for together, grid in zip(describe_all(grids, config), grids, strict=True):
        alone = describe(grid, config)
        np.testing.assert_array_equal(together.points, alone.points)
        np.testing.assert_array_equal(together.descriptors, alone.descriptors)
    assert describe_all([], config) == []


def test_keypoints_lie_inside_the_map_in_metres(rooms):
    grid = rooms(2)
    shifted = TbmGrid(grid.geometry._replace(origin_x=-50.0, origin_y=7.0), grid.masses)
    features = describe(shifted, CONFIG)
    min_x, min_y, max_x, max_y = shifted.geometry.bounds()
    assert 100 < len(features) <= CONFIG.keypoints
    assert np.all((features.points > (min_x, min_y)) & (features.points < (max_x, max_y)))


def test_fewer_keypoints_can_be_asked_for(rooms):
    assert len(describe(rooms(2), FeatureConfig(keypoints=50))) <= 50


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (300, 300)])
def test_a_map_without_contrast_has_no_keypoints(shape):
    blank = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, *shape))
    features = describe(blank, CONFIG)
    assert len(features) == 0
    assert len(match(features, features, CONFIG)) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_a_ratio_needs_two_keypoints_to_compare(rooms, count):
    many = describe(rooms(3), CONFIG)
    few = Features(many.points[:count], many.descriptors[:count])
    assert len(match(few, many, CONFIG)) == 0
    assert len(match(many, few, CONFIG)) == 0


def test_a_stricter_ratio_keeps_fewer_matches(rooms):
    target = rooms(4)
    source = warp(target, SE2(0.0, 0.0, 0.5), target.geometry)
    counts = [
        len(match(describe(target, CONFIG), describe(source, CONFIG), FeatureConfig(ratio=ratio)))
        for ratio in (0.5, 0.7, 0.9)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]
