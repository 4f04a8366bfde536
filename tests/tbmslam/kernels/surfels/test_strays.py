import math

import numpy as np
import pytest

from tbmslam.kernels.surfels.strays import count_strays
from tbmslam.kernels.surfels.surfel_alignment import pair_up
from tests import reference
from tests.tbmslam.kernels.surfels.surfel_rooms import facing_origin, room_walls, surfels_of

ANGLES = np.linspace(-np.pi, np.pi, 300, endpoint=False)
STEP = 2.0 * np.pi / 300
POSE = (0.01, 0.0, 0.002)
BLIND = (np.zeros(0), 0.0, 1.0, (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def surfels():
    """The walls of a room of 6 x 4 m, as plain tuples."""
    surfels = surfels_of(room_walls(np.random.default_rng(4)))
    return (*surfels[:3], tuple(surfels.lattice), surfels.limits)


def room_ranges(nearer=slice(0), factor=0.5):
    """Ranges to the walls from the middle of the room; some are shortened by an object before them."""
    ranges = np.minimum(3.0 / np.abs(np.cos(ANGLES)), 2.0 / np.maximum(np.abs(np.sin(ANGLES)), 1e-9))
    ranges[nearer] *= factor
    return ranges


def counted(surfels, ranges, view=BLIND, span=0.5, tolerance=4.0, pose=POSE):
    points = np.column_stack((np.cos(ANGLES), np.sin(ANGLES))) * ranges[:, None]
    return count_strays(surfels, points, facing_origin(points), pose, span, tolerance, view)


@pytest.mark.parametrize(("span", "tolerance"), [(0.01, 4.0), (0.5, 4.0), (0.5, 12.0)])
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_strays_match_no_surfel(surfels, span, tolerance, factor):
    """As the registration counts what matches."""
    ranges = room_ranges(slice(40, 60), factor)
    points, pairs = np.column_stack((np.cos(ANGLES), np.sin(ANGLES))) * ranges[:, None], np.empty((8, 301))
    count, independent = pair_up(surfels, points, facing_origin(points), 1, span, POSE, pairs)
    expected = independent - reference.normal_equations(pairs[:, :count], POSE, tolerance)[0]
    assert counted(surfels, ranges, span=span, tolerance=tolerance)[0] == pytest.approx(
        expected, rel=1e-6
    )  # uncompiled: float32


@pytest.mark.parametrize("reversed_beams", [False, True])
@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_free_space_is_what_an_earlier_scan_saw_through(surfels, reversed_beams, unknown):
    """By a slow twin with the directions of all beams; beams without a hit saw nothing."""
    generator = np.random.default_rng(1)
    seen = room_ranges(slice(30, 50))
    seen[generator.random(300) < 0.1] = unknown
    first, step, origin = 0.3, -STEP if reversed_beams else STEP, (0.4, -0.3, 1.0)
    total = 0.0
    for beam in range(300):
        for range_ in (0.5, 1.5, 1.95):
            ranges = np.full(300, 50.0)  # beyond the map, and behind all that was seen
            ranges[beam] = range_
            everywhere, free = counted(surfels, ranges, (seen, first, step, origin), span=0.01)
            x, y = POSE[0] + range_ * math.cos(ANGLES[beam] + POSE[2]), range_ * math.sin(ANGLES[beam] + POSE[2])
            expected = reference.saw_free(seen, first, step, origin, (x, y), 0.1)
            assert free == pytest.approx(everywhere - 299.0 if expected else 0.0, abs=1e-9)
            total += free
    assert total > 200.0


def test_hits_between_those_of_the_last_view_on_a_wall_seen_at_a_small_angle_are_not_in_free_space(surfels):
    """No surfel is there, and the beams beside such a hit end metres behind it."""
    lateral, step = 0.8, 0.01
    along = np.arange(0.02, 1.0, step)
    view = lateral / np.sin(along), along[0], step, (0.0, 0.0, 0.0)
    between = along[4:-1] + 0.4 * step
    points = np.column_stack((lateral / np.tan(between), np.full(len(between), lateral)))
    normals = np.tile([0.0, -1.0], (len(points), 1))
    nowhere = (*surfels[:1], *(np.zeros_like(array) for array in surfels[1:3]), *surfels[3:])
    _, there = count_strays(nowhere, points, normals, (0.0, -0.06, 0.0), 0.5, 4.0, view)
    _, aside = count_strays(nowhere, points, normals, (0.0, -0.3, 0.0), 0.5, 4.0, view)
    assert there == 0.0
    assert aside > 5.0


def test_a_view_without_beams_saw_no_free_space(surfels):
    strays, free = counted(surfels, room_ranges(slice(40, 60)))
    assert strays > 1.0
    assert free == 0.0


def test_an_object_in_the_room_contradicts_the_last_view_and_a_new_room_does_not(surfels):
    view = (room_ranges(), -np.pi, STEP, (0.0, 0.0, 0.0))
    bare = counted(surfels, room_ranges(), view)
    more, freed = np.subtract(counted(surfels, room_ranges(slice(40, 60)), view), bare)
    assert more > 1.0
    assert freed == pytest.approx(more, rel=0.1)
    more, freed = np.subtract(counted(surfels, room_ranges(slice(40, 60), 1.5), view), bare)
    assert more > 1.0
    assert freed == pytest.approx(0.0, abs=0.05)
