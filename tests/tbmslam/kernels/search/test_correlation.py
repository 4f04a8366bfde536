import math

import numpy as np

from tbmslam.kernels.rays.counting import ONE_HIT
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.search.correlation import (
    WALL,
    coarser_field,
    correlate,
    search_field,
    share_in_free_space,
    top_places,
)


def test_sums_are_the_plain_ones():
    generator = np.random.default_rng(0)
    lattice = Lattice(0.2, -7, 3)
    field = generator.integers(-100, 101, (20, 30)).astype(np.int8)
    points = generator.uniform(-4.0, 4.0, (40, 2))
    turns = np.array([-0.3, 0.0, 0.8])
    x, y, theta = guess = (3.7, 0.4, 0.2)
    sums = correlate(field, lattice, points, guess, turns, 4)
    assert sums.shape == (3, 9, 9)
    for k, turn in enumerate(turns):
        c, s = math.cos(theta + turn), math.sin(theta + turn)
        for dr in range(-4, 5):
            for dc in range(-4, 5):
                total = 0
                for px, py in points:
                    row = math.floor((y + s * px + c * py) / 0.2) + 7 + dr
                    col = math.floor((x + c * px - s * py) / 0.2) - 3 + dc
                    if 0 <= row < 20 and 0 <= col < 30:
                        total += int(field[row, col])
                assert sums[k, dr + 4, dc + 4] == total


def test_a_coarser_field_has_the_largest_values():
    field = np.random.default_rng(0).integers(-100, 101, (5, 7)).astype(np.int8)
    coarse, lattice = coarser_field(field, Lattice(0.2, -3, 2))
    assert lattice == (0.4, -2, 1)
    expected = np.full((3, 4), -128)
    for row in range(5):
        for col in range(7):
            cell = (row - 3) // 2 + 2, (col + 2) // 2 - 1
            expected[cell] = max(expected[cell], field[row, col])
    np.testing.assert_array_equal(coarse, expected)


def test_a_field_out_of_reach_is_nothing():
    field = np.ones((5, 5), dtype=np.int8)
    assert not correlate(field, Lattice(0.2, 0, 0), np.zeros((3, 2)), (100.0, 0.0, 0.0), np.zeros(1), 3).any()


def test_a_field_gains_on_walls_and_beside_them_and_loses_where_it_is_free():
    counts = np.zeros((5, 7), dtype=np.int64)
    counts[2:, 3:] = 2
    counts[0, 5] = 1
    counts[0, 0] += ONE_HIT
    counts[3, 3] += ONE_HIT
    wall, free = WALL, -WALL // 2
    expected = [
        [wall, wall, 0, 0, 0, 0, 0],
        [wall, wall, 0, 0, 0, 0, 0],
        [0, 0, wall, wall, wall, free, free],
        [0, 0, wall, wall, wall, free, free],
        [0, 0, wall, wall, wall, free, free],
    ]
    np.testing.assert_array_equal(search_field(counts, 0.5), expected)


def test_points_in_free_space_are_counted():
    field = np.zeros((4, 4), dtype=np.int8)
    field[1, 2] = -1
    points = np.array([[0.1, 0.0], [0.3, 0.0], [9.0, 9.0], [-9.0, 0.0]])
    assert share_in_free_space(field, Lattice(0.2, 0, 0), points, (0.4, 0.3, 0.0)) == 0.25
    assert share_in_free_space(field, Lattice(0.2, 0, 0), np.zeros((0, 2)), (0.4, 0.3, 0.0)) == 0.0


def test_the_best_places_are_apart():
    sums = np.zeros((2, 7, 7), dtype=np.int32)
    sums[1, 2, 3], sums[0, 3, 4], sums[1, 6, 3] = 50, 45, 40
    scores, places = top_places(sums, 1.0, 1, 2)
    np.testing.assert_array_equal(scores, [49.0, 37.0])
    np.testing.assert_array_equal(places, [[1, 2, 3], [1, 6, 3]])
    assert top_places(sums, 20.0, 1, 1)[1].tolist() == [[1, 2, 3]]
    assert top_places(np.zeros((1, 1, 1), dtype=np.int32), 1.0, 1, 2)[0][1] == -np.inf


def test_a_place_hides_just_what_lies_within_reach_of_it():
    """On every side alike, and up to the border of the sums."""
    for row, col in ((5, 5), (0, 9), (9, 0)):
        sums = np.zeros((1, 11, 11), dtype=np.int32)
        sums[0, row, col] = 100
        for drow, dcol in ((-3, 0), (3, 0), (0, -3), (0, 3), (-2, 2), (2, -2), (2, 2), (-2, -2)):
            if 0 <= row + drow < 11 and 0 <= col + dcol < 11:
                sums[0, row + drow, col + dcol] = 50 if max(abs(drow), abs(dcol)) == 3 else 90
        away = np.argwhere(sums[0] == 50)
        scores, places = top_places(sums, 0.0, 2, 1 + len(away))
        np.testing.assert_array_equal(scores, [100.0, *[50.0] * len(away)])
        assert {tuple(place) for place in places[1:, 1:]} == {tuple(place) for place in away}
