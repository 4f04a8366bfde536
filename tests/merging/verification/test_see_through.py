import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from merging.config.registration import StructureConfig, VerificationConfig
from merging.verification import seen_through_m, stretches_m
from merging.walls import Components, WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

REACH_M = VerificationConfig().see_through_m


def hall(*things):
    """A hall of 10 x 10 m with things in it, given as windows of cells."""
    masses = np.zeros((240, 240, 4), dtype=np.float32)
    masses[..., 3] = 1.0
    masses[18:222, 18:222] = (0.0, 0.0, 1.0, 0.0)
    masses[20:220, 20:220] = (0.0, 1.0, 0.0, 0.0)
    for thing in things:
        masses[thing] = (0.0, 0.0, 1.0, 0.0)
    return WallMap.from_grid(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 240, 240), masses), StructureConfig())


def test_a_wall_across_a_free_room_counts_but_for_a_door():
    across = hall(np.s_[119:121, 60:180])
    assert seen_through_m(hall(), across, SE2.identity(), REACH_M) == pytest.approx((6.0 - 0.8) / 2.0, abs=0.2)
    assert seen_through_m(across, hall(), SE2.identity(), REACH_M) == pytest.approx((6.0 - 0.8) / 2.0, abs=0.2)


def test_things_and_doors_do_not():
    furnished = hall(np.s_[60:74, 60:74], np.s_[100:102, 80:98], np.s_[160:176, 100:102])
    assert seen_through_m(hall(), furnished, SE2.identity(), REACH_M) == 0.0
    assert seen_through_m(hall(), hall(), SE2.identity(), REACH_M) == 0.0


def test_a_wall_that_bent_away_does_not_and_what_stands_beside_it_hides_nothing():
    across, bent = hall(np.s_[119:121, 60:180]), hall(np.s_[127:129, 60:180])
    assert seen_through_m(across, bent, SE2.identity(), REACH_M) == 0.0
    crossed = hall(*(np.s_[col - 20 : col + 20, col : col + 2] for col in (100, 140)))  # stand upright, seen end on
    assert seen_through_m(crossed, across, SE2.identity(), REACH_M) > 0.0


def test_it_is_as_long_in_any_direction():
    aslant = hall(*(np.s_[row, row - 1 : row + 2] for row in range(60, 160)))
    assert seen_through_m(hall(), aslant, SE2.identity(), REACH_M) == pytest.approx((5.0 * 2**0.5 - 0.8) / 2.0, abs=0.2)


def test_maps_apart_do_not_contradict():
    assert seen_through_m(hall(), hall(), SE2(500.0, 0.0, 0.0), REACH_M) == 0.0


def slow_stretches_m(cells, resolution):
    """The same in an image of all cells."""
    image = np.zeros(np.ptp(cells, axis=0) + 3, np.uint8)
    image[tuple((cells - cells.min(axis=0) + 1).T)] = 1
    pieces = Components.of(cv2.dilate(image, np.ones((3, 3), np.uint8)) > 0)
    longest = np.hypot(*pieces.sides) * resolution
    longest[0] = 0.0
    longer = [max(cv2.minAreaRect(pieces.cells_of(index))[1]) for index in np.flatnonzero(longest > 0.8)]
    return sum(max(float(side) * resolution - resolution - 0.8, 0.0) for side in longer)


@given(seed=st.integers(0, 10_000), walls=st.integers(1, 30), resolution=st.sampled_from([0.03, 0.05, 0.1]))
def test_stretches_are_those_of_an_image_to_the_last_bit(seed, walls, resolution):
    rng = np.random.default_rng(seed)
    begins, ends = rng.integers(0, 200, size=(2, walls, 2))
    shares = np.linspace(0.0, rng.uniform(0.1, 1.0), 40)[:, None, None]
    cells = np.rint(begins + shares * (ends - begins)).astype(np.int64).reshape(-1, 2)
    assert stretches_m(cells, resolution) == slow_stretches_m(cells, resolution)
