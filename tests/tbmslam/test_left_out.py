import numpy as np
import pytest

from tbmslam.left_out import left_out_said
from tbmslam.segmentation import Itinerary, split_at_intervals

STAMPS = 1000.0 + 0.2 * np.arange(100)
NO_INTERVAL = (
    "left out of the map, and as the clock steps back no --interval names it: write its 60 scans into a file of their "
    "own, and map that"
)


def stepped(*steps):
    """Return the stamps with the clock set forth (or back) by so many seconds at some readings."""
    stamps = STAMPS.copy()
    for reading, seconds in steps:
        stamps[reading:] += seconds
    return stamps


def taken(stamps, said):
    """Return what --interval as told makes a robot of."""
    first, last = (float(number) for number in said.split("--interval ")[1].split())
    (segment,) = split_at_intervals(Itinerary(stamps, np.zeros(len(stamps))), [(first, last)])
    return tuple(segment)


@pytest.mark.parametrize("part", [(0, 40), (40, 100), (30, 31), (0, 1), (99, 100), (17, 63)])
@pytest.mark.parametrize("rate", [1.0, 0.07, 30.0])
def test_an_interval_names_all_of_a_part_and_nothing_else(part, rate):
    stamps = 1.3e9 + rate * np.arange(100) / 3.0
    said = left_out_said(stamps, *part, stamps[0])
    assert said.startswith("left out of the map, make a robot of it by --interval ")
    assert taken(stamps, said) == part


def test_times_count_from_where_the_recording_began():
    assert left_out_said(STAMPS + 0.005, 10, 20, 990.0).endswith("--interval 12.00 13.81")


@pytest.mark.parametrize("step", [-15.0, -100.0])
def test_a_clock_that_steps_back_to_before_a_part_leaves_no_interval(step):
    """What lies between its first and its last stamp is nothing."""
    stamps = stepped((60, step))
    assert left_out_said(stamps, 40, 100, stamps[0]) == NO_INTERVAL


@pytest.mark.parametrize("step", [-1.0, -5.0])
def test_one_that_steps_back_by_less_does(step):
    """What lies between the first reading inside and the last belongs to it, whatever its stamp."""
    stamps = stepped((60, step))
    assert taken(stamps, left_out_said(stamps, 40, 100, stamps[0])) == (40, 100)


def test_nor_does_one_that_makes_another_part_as_early():
    stamps = stepped((60, -10.0))
    assert left_out_said(stamps, 0, 60, stamps[0]) == NO_INTERVAL


def test_a_clock_that_was_set_right_between_parts_matters_not():
    stamps = stepped((40, -1e6))
    for part in ((0, 40), (40, 100)):
        assert taken(stamps, left_out_said(stamps, *part, stamps[0])) == part


def test_stamps_that_shake_do_not_matter():
    stamps = STAMPS + 0.15 * (-1.0) ** np.arange(100)
    first, last = taken(stamps, left_out_said(stamps, 20, 80, stamps[0]))
    assert abs(first - 20) <= 1
    assert abs(last - 80) <= 1


def test_scans_of_one_stamp_have_no_interval():
    assert "no --interval" in left_out_said(np.full(100, 5.0), 40, 100, 5.0)
