import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids.wall_sliding import slide_walls
from tbmslam.kernels.grids.walls import Limits, Walls, classify_walls, compare_walls, see_through_walls
from tests import wall_reference

LIMITS = Limits(0.153, 0.307, 0.3, 0.7)  # which no distance between cells meets exactly
MOTIONS = [SE2(0.0, 0.0, 0.0), SE2(0.12, -0.07, 0.05), SE2(1.0, -0.5, math.pi / 2), SE2(-2.0, 3.0, 2.5)]


def some_map(seed):
    """Random walls between random cells, with distances by brute force."""
    generator = np.random.default_rng(seed)
    rows, cols, resolution, origin = 30, 40, 0.1, np.array([-2.0, -1.5])
    states = generator.choice(np.array([0, 1, 2], np.uint8), (rows // 5, cols // 5)).repeat(5, 0).repeat(5, 1)
    cells = np.unique(generator.integers(0, (rows, cols), (60, 2)), axis=0)
    points = origin + (cells[:, ::-1] + 0.5) * resolution
    directions = generator.choice([0.0, math.pi / 2, math.pi, -math.pi / 2], len(points))
    directions += generator.normal(0.0, 0.2, len(points))
    y, x = np.mgrid[0:rows, 0:cols]
    centres = origin + (np.stack((x, y), axis=-1) + 0.5) * resolution
    apart = np.linalg.norm(centres[:, :, None] - points, axis=-1)
    return Walls(
        points,
        np.column_stack((np.cos(directions), np.sin(directions))),
        generator.random(len(points)) < 0.2,
        generator.uniform(0.1, 1.0, len(points)),
        apart.min(axis=2).astype(np.float32),
        apart.argmin(axis=2).astype(np.int32),
        np.ascontiguousarray(states),
        resolution,
        float(origin[0]),
        float(origin[1]),
    )


@pytest.fixture(scope="module")
def maps():
    return some_map(1), some_map(2)


def every(walls):
    return np.arange(len(walls.points))


def test_what_becomes_of_a_wall_is_the_plain_answer(maps):
    fixed, moving = maps
    seen = set()
    for motion in MOTIONS:
        found = classify_walls(moving, every(moving), fixed, motion, LIMITS)
        expected = [wall_reference.held(moving, k, fixed, motion, LIMITS) for k in every(moving)]
        np.testing.assert_array_equal(found, expected)
        seen |= set(expected)
    assert seen == {0, 1, 2, 3, 4}  # all of them occur


@pytest.mark.parametrize("reach", [0.0, 0.2, 0.45])
def test_walls_seen_through_are_the_plain_ones(maps, reach):
    fixed, moving = maps
    found = [see_through_walls(moving, fixed, motion, reach) for motion in MOTIONS]
    for motion, some in zip(MOTIONS, found, strict=True):
        np.testing.assert_array_equal(
            some, [wall_reference.seen_through(moving, k, fixed, motion, reach) for k in every(moving)]
        )
    assert 0 < np.count_nonzero(found) < np.size(found)


def test_sums_are_the_plain_ones(maps):
    fixed, moving = maps
    some = every(moving)[::2]
    found = compare_walls(moving, some, fixed, np.array(MOTIONS), LIMITS)
    expected = [wall_reference.compared(moving, some, fixed, motion, LIMITS) for motion in MOTIONS]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert found[:, 1].max() > 0.0


@pytest.mark.parametrize("motion", MOTIONS[:3])
def test_a_step_is_the_plain_one(maps, motion):
    target, source = maps
    some = every(target)[::2], every(source)[1:]
    (found,) = slide_walls(target, some[0], source, some[1], np.array([motion]), np.array([0.4]), 0.7)
    expected = wall_reference.slid(target, some[0], source, some[1], motion, 0.4, 0.7)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.abs(np.subtract(found, motion)).max() > 1e-3


def test_steps_follow_each_other(maps):
    target, source = maps
    reaches = np.array([0.6, 0.4, 0.3])
    (found,) = slide_walls(target, every(target), source, every(source), np.array([MOTIONS[1]]), reaches, 0.7)
    expected = MOTIONS[1]
    for reach in reaches:
        expected = wall_reference.slid(target, every(target), source, every(source), expected, float(reach), 0.7)
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_maps_apart_stay_where_they_are(maps):
    target, source = maps
    far = np.array([(50.0, 0.0, 1.0)])
    found = slide_walls(target, every(target), source, every(source), far, np.array([0.5, 0.2]), 0.7)
    np.testing.assert_array_equal(found, far)
    assert not compare_walls(source, every(source), target, far, LIMITS).any()


def test_a_wall_beyond_the_border_is_not_unseen(maps):
    """What lies in front of it is outside the map; in memory the next row's first cell follows."""
    fixed, moving = maps
    rows, cols = fixed.states.shape
    lone = fixed._replace(
        states=np.ones_like(fixed.states) * (np.arange(cols) == 0).astype(np.uint8),
        distances=np.full((rows, cols), 9.0, np.float32),
    )
    right = np.array([[fixed.origin_x + cols * 0.1 - 0.05, fixed.origin_y + 1.05]])
    wall = moving._replace(
        points=right, normals=np.array([[1.0, 0.0]]), two_sided=np.zeros(1, bool), weights=np.ones(1)
    )
    limits = LIMITS._replace(front=0.1)
    expected = wall_reference.compared(wall, [0], lone, SE2.identity(), limits)
    np.testing.assert_array_equal(compare_walls(wall, np.array([0]), lone, np.zeros((1, 3)), limits), [expected])


def test_a_map_slides_back_onto_itself(maps):
    walls, _ = maps
    guess = np.array([(0.04, -0.03, 0.02)])
    found = slide_walls(walls, every(walls), walls, every(walls), guess, np.geomspace(0.3, 0.05, 20), 0.7)
    np.testing.assert_allclose(found, np.zeros((1, 3)), atol=0.01)
