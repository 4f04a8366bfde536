import math
from typing import get_args

import numpy as np
import pytest

from merging.config.choices import Descriptor
from merging.config.registration import FeatureConfig
from merging.fusion.warping import warp
from merging.registration.features import Features, describe, describe_all, match
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

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
