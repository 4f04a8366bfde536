"""Grids read on other cells: motions that carry cells onto cells lose nothing, and do what their product does."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import UNKNOWN
from tbmslam.geometry.se2 import SE2

RESOLUTION = 0.05
steps = st.integers(-40, 40)
sizes = st.integers(1, 12)
resolutions = st.sampled_from([0.01, 0.03, 0.05, 0.1, 0.25, 1.0 / 3.0])


def grid_of(seed, rows, cols, resolution=RESOLUTION, col=0, row=0):
    masses = np.random.default_rng(seed).dirichlet(np.ones(4), size=(rows, cols)).astype(np.float32)
    return TbmGrid(GridGeometry(resolution, resolution * col, resolution * row, rows, cols), masses)


def shifted(geometry, cols, rows):
    return geometry._replace(
        origin_x=geometry.origin_x + cols * geometry.resolution, origin_y=geometry.origin_y + rows * geometry.resolution
    )


@settings(deadline=None)
@given(st.integers(0, 99), sizes, sizes, resolutions, steps, steps)
def test_the_identity_changes_no_bit(seed, rows, cols, resolution, col, row):
    grid = grid_of(seed, rows, cols, resolution, col, row)
    assert resample(grid, SE2.identity(), grid.geometry).masses.tobytes() == grid.masses.tobytes()


@settings(deadline=None)
@given(st.integers(0, 99), sizes, sizes, resolutions, steps, steps, steps, steps)
def test_shifts_by_whole_cells_keep_every_mass_and_add_up(seed, rows, cols, resolution, x, y, more_x, more_y):
    grid = grid_of(seed, rows, cols, resolution)
    first, second = SE2(x * resolution, y * resolution, 0.0), SE2(more_x * resolution, more_y * resolution, 0.0)
    once = resample(grid, first, shifted(grid.geometry, x, y))
    assert once.masses.tobytes() == grid.masses.tobytes()
    there = shifted(grid.geometry, x + more_x, y + more_y)
    both, one_by_one = resample(grid, second @ first, there), resample(once, second, there)
    assert both.masses.tobytes() == one_by_one.masses.tobytes() == grid.masses.tobytes()


@settings(deadline=None)
@given(st.integers(0, 99), sizes, sizes, st.integers(-3, 3), steps, steps)
def test_quarter_turns_are_exact_and_add_up(seed, rows, cols, turns, x, y):
    grid = grid_of(seed, rows, cols)
    motion = SE2(x * RESOLUTION, y * RESOLUTION, 0.5 * math.pi * turns)
    min_x, min_y, max_x, max_y = grid.geometry.bounds()
    corners = motion.apply(np.array([[min_x, min_y], [max_x, max_y]]))
    left, bottom = corners.min(axis=0)
    size = (cols, rows) if turns % 2 else (rows, cols)
    turned = resample(grid, motion, GridGeometry(RESOLUTION, float(left), float(bottom), *size))
    # Rows grow with y, so that a turn to the left turns the array the other way.
    np.testing.assert_array_equal(turned.masses, np.rot90(grid.masses, -turns))
    back = resample(turned, motion.inverse(), grid.geometry)
    assert back.masses.tobytes() == grid.masses.tobytes()


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 99), st.floats(-math.pi, math.pi), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_any_motion_keeps_the_mass_of_what_lies_inside_nearly(seed, theta, x, y):
    """Cells are read at their centres: of a disc far from all borders the masses stay but for its rim."""
    grid = TbmGrid.unknown(GridGeometry(RESOLUTION, -2.0, -2.0, 80, 80))
    rows, cols = np.mgrid[0:80, 0:80]
    disc = np.hypot(rows - 39.5, cols - 39.5) < 20.0
    grid.masses[disc] = np.random.default_rng(seed).dirichlet(np.ones(4)).astype(np.float32)
    moved = resample(grid, SE2(x, y, theta), grid.geometry)
    before, after = ((1.0 - each.masses[..., UNKNOWN]).sum() for each in (grid, moved))
    assert abs(after - before) <= 0.03 * before
    np.testing.assert_allclose(moved.masses.sum(axis=-1), 1.0, atol=1e-6)
