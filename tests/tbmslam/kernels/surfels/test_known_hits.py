import numpy as np
import pytest

from tbmslam.kernels.rays.hits import hits_of_scan
from tbmslam.kernels.surfels.known_hits import count_known_hits
from tbmslam.kernels.surfels.outline import outline_of
from tbmslam.kernels.surfels.surfel_alignment import pair_up
from tests import reference
from tests.tbmslam.kernels.surfels.surfel_rooms import facing_origin, room_walls, surfels_of

ANGLES = np.linspace(-np.pi, np.pi, 300, endpoint=False)
POSE = (0.01, 0.0, 0.002)
BLIND = (np.zeros((0, 4)), 0.0, 1.0, (0.0, 0.0, 0.0))


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


def counted(surfels, ranges, outline=BLIND, span=0.5, tolerance=4.0, pose=POSE):
    points = np.column_stack((np.cos(ANGLES), np.sin(ANGLES))) * ranges[:, None]
    return count_known_hits(surfels, points, facing_origin(points), pose, span, tolerance, outline)


@pytest.mark.parametrize(("span", "tolerance"), [(0.01, 4.0), (0.5, 4.0), (0.5, 12.0)])
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_known_hits_lie_on_surfels_and_strays_do_not(surfels, span, tolerance, factor):
    """As the registration counts what matches."""
    ranges = room_ranges(slice(40, 60), factor)
    points, pairs = np.column_stack((np.cos(ANGLES), np.sin(ANGLES))) * ranges[:, None], np.empty((8, 301))
    count, independent = pair_up(surfels, points, facing_origin(points), 1, span, POSE, pairs)
    known = reference.normal_equations(pairs[:, :count], POSE, tolerance)[0]
    assert counted(surfels, ranges, span=span, tolerance=tolerance) == pytest.approx(
        (known, independent - known), rel=1e-6
    )  # uncompiled: float32


def test_hits_between_those_of_the_last_keyframe_are_known(surfels):
    """Their ends lie so far apart that no surfel is there."""
    angles = np.linspace(-0.5, 0.5, 6)
    ranges = 2.0 / np.cos(angles)
    outline = outline_of(ranges, angles[0], angles[1] - angles[0], (0.0, 0.0, 0.0)), angles[0], angles[1] - angles[0]
    points = np.column_stack((np.full(40, 2.0), np.linspace(-1.0, 1.0, 40)))
    normals = np.tile([-1.0, 0.0], (40, 1))
    nowhere = (*surfels[:1], *(np.zeros_like(array) for array in surfels[1:3]), *surfels[3:])

    def strays(pose):
        return count_known_hits(nowhere, points, normals, pose, 0.5, 4.0, (*outline, (0.0, 0.0, 0.0)))[1]

    everything = count_known_hits(nowhere, points, normals, (0.0, 0.0, 0.0), 0.5, 4.0, BLIND)[1]
    assert everything > 3.5
    assert strays((0.0, 0.0, 0.0)) < 0.01
    assert strays((0.1, 0.0, 0.0)) == pytest.approx(0.5 * everything, rel=0.1)
    assert strays((0.5, 0.0, 0.0)) > 0.9 * everything


def test_hits_far_along_a_corridor_lie_on_its_walls(surfels):
    """Their neighbours are so far apart that `write_normals` does not know their normals."""
    step = np.deg2rad(1.0)
    ranges = np.minimum(1.0 / np.maximum(np.abs(np.sin(step * np.arange(-30.0, 31.0))), 1e-9), 40.0)
    outline = outline_of(ranges, -30.0 * step, step, (0.0, 0.0, 0.0)), -30.0 * step, step, (0.0, 0.0, 0.0)
    nowhere = (*surfels[:1], *(np.zeros_like(array) for array in surfels[1:3]), *surfels[3:])

    def strays(distance, pose):
        points, normals = hits_of_scan(distance, -30.0 * step, step, (0.0, 0.0, 0.0), 39.0)
        far = np.hypot(*points.T) > 5.0
        assert far.sum() > 15
        return count_known_hits(nowhere, points[far], normals[far], pose, 0.5, 4.0, outline)[1]

    assert strays(ranges, (0.3, 0.0, 0.0)) < 4.0  # the farthest are beyond the end of the outline
    assert strays(ranges, (0.3, 0.0, 0.5)) > 15.0
    # Hits on no line are objects, wherever they are.
    clutter = ranges * np.where(np.arange(61) % 2, 1.0, 0.7)
    assert strays(clutter, (0.0, 0.0, 0.0)) > 15.0
