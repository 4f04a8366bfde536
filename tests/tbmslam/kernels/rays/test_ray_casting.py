import math

import numpy as np
import pytest

from tbmslam.kernels.rays.ray_casting import cast_rays

SQUARE = np.array([[-2.0, -3, 4, -3], [4, -3, 4, 1], [4, 1, -2, 1], [-2, 1, -2, -3]])


def slow_ranges(walls, sensors, angle_min, angle_increment, limit, beams):
    """Every beam against every segment, by Cramer's rule."""
    ranges = np.full((len(sensors), beams), np.inf)
    for scan, (x, y, theta) in enumerate(sensors):
        for beam in range(beams):
            direction = theta + angle_min + beam * angle_increment
            dx, dy = math.cos(direction), math.sin(direction)
            for x0, y0, x1, y1 in walls:
                determinant = dx * (y0 - y1) - dy * (x0 - x1)
                if determinant == 0.0:
                    continue
                along = ((x0 - x) * (y0 - y1) - (y0 - y) * (x0 - x1)) / determinant
                on_wall = (dx * (y0 - y) - dy * (x0 - x)) / determinant
                if along > 0.0 and -1e-9 <= on_wall <= 1.0 + 1e-9 and along <= limit:
                    ranges[scan, beam] = min(ranges[scan, beam], along)
    return ranges


@pytest.mark.parametrize(
    ("angle_min", "angle_increment", "beams"),
    [
        (-2.2689, 0.025, 180),
        (2.2689, -0.025, 180),
        (-math.pi, 2 * math.pi / 200, 200),
        (0.3, 0.01, 40),
        (5.0, 0.02, 90),
    ],
)
def test_agrees_with_every_beam_against_every_wall(angle_min, angle_increment, beams):
    rng = np.random.default_rng(beams)
    starts = rng.uniform(-10, 10, (40, 2))
    walls = np.hstack((starts, starts + rng.uniform(-3, 3, (40, 2))))
    sensors = np.column_stack((rng.uniform(-8, 8, (12, 2)), rng.uniform(-7, 7, 12)))
    ranges = np.empty((12, beams))
    cast_rays(walls, sensors, angle_min, angle_increment, 6.0, ranges)
    expected = slow_ranges(walls, sensors, angle_min, angle_increment, 6.0, beams)
    assert np.isinf(expected).any()
    np.testing.assert_allclose(ranges, expected, rtol=1e-9)


def test_no_beam_leaves_a_closed_room():
    rng = np.random.default_rng(0)
    sensors = np.column_stack((rng.uniform(-1.9, 3.9, 300), rng.uniform(-2.9, 0.9, 300), rng.uniform(-4, 4, 300)))
    ranges = np.empty((300, 1440))
    cast_rays(SQUARE, sensors, -math.pi, 2 * math.pi / 1440, 30.0, ranges)
    assert np.isfinite(ranges).all()


def test_beams_straight_into_corners_end_there():
    sensors = np.array([[0.0, 0.0, 0.0]])
    ranges = np.empty((1, 8))
    corners = np.array([[1.0, 1, -1, 1], [-1, 1, -1, -1], [-1, -1, 1, -1], [1, -1, 1, 1]])
    cast_rays(corners, sensors, -math.pi, math.pi / 4, 30.0, ranges)
    np.testing.assert_allclose(ranges[0], [1, math.sqrt(2)] * 4)


def test_walls_beyond_the_limit_and_walls_seen_end_on_are_not_seen():
    ranges = np.empty((1, 3))
    cast_rays(np.array([[5.0, -1, 5, 1], [1, 0, 2, 0]]), np.array([[0.0, 0, 0]]), -0.1, 0.1, 4.9, ranges)
    assert np.isinf(ranges).all()
