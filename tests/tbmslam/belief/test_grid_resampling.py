import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import PlacedGrid, resample
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tests.reference import is_inside


def random_grid(seed, rows=7, cols=11, resolution=0.1, origin=(-0.35, 1.25)):
    masses = np.random.default_rng(seed).dirichlet(np.ones(4), size=(rows, cols)).astype(np.float32)
    return TbmGrid(GridGeometry(resolution, *origin, rows, cols), masses)


def slow_resample(grid, T_target_source, geometry, samples):
    """The same from the definition: where does each sample lie, what is there, and is any of it a wall."""
    resampled = np.zeros((geometry.rows, geometry.cols, 4))
    for row in range(geometry.rows):
        for col in range(geometry.cols):
            covered = []
            for i in range(samples * samples):
                x = geometry.origin_x + (col + (i % samples + 0.5) / samples) * geometry.resolution
                y = geometry.origin_y + (row + (i // samples + 0.5) / samples) * geometry.resolution
                cell = grid.geometry.cell_at(*T_target_source.inverse().apply([x, y]))
                covered.append(grid.masses[cell] if is_inside(grid.geometry, *cell) else np.array([0.0, 0.0, 0.0, 1.0]))
            walls = [belief for belief in covered if belief[OCCUPIED] > belief[FREE]]
            resampled[row, col] = max(walls, key=lambda belief: belief[OCCUPIED]) if walls else np.mean(covered, axis=0)
    return resampled


def test_a_shift_by_whole_cells_is_exact_and_the_rest_is_unknown():
    grid = random_grid(2)
    result = resample(grid, SE2(0.3, -0.2, 0.0), grid.geometry)
    np.testing.assert_array_equal(result.masses[:-2, 3:], grid.masses[2:, :-3])
    assert np.all(result.masses[-2:, :, UNKNOWN] == 1.0)
    assert np.all(result.masses[:, :3, UNKNOWN] == 1.0)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 1000),
    x=st.floats(-2.0, 2.0),
    y=st.floats(-2.0, 2.0),
    theta=st.floats(-math.pi, math.pi),
    resolution=st.sampled_from([0.03, 0.07, 0.1]),
)
def test_it_reads_the_cell_under_each_centre(seed, x, y, theta, resolution):
    grid, motion = random_grid(seed), SE2(x, y, theta)
    geometry = GridGeometry(resolution, -0.71, 0.93, 9, 8)
    result = resample(grid, motion, geometry)
    disagreeing = np.any(result.masses != slow_resample(grid, motion, geometry, 1).astype(np.float32), axis=-1)
    assert disagreeing.mean() <= 0.05  # a centre on a cell's edge may fall to either side


@pytest.mark.parametrize(("resolution", "samples"), [(0.2, 2), (0.25, 3)])
def test_coarser_cells_take_the_wall_that_they_cover_or_the_mean(resolution, samples):
    grid, motion = random_grid(3, rows=20, cols=20), SE2(0.1234, -0.0531, 0.4)
    geometry = GridGeometry(resolution, -0.517, 0.913, 8, 9)
    result = resample(grid, motion, geometry)
    np.testing.assert_allclose(result.masses, slow_resample(grid, motion, geometry, samples), atol=1e-6)


@pytest.mark.parametrize("resolution", [0.1, 0.2])
def test_a_thin_wall_stays_a_wall_in_coarser_cells(resolution):
    masses = np.zeros((20, 20, 4), dtype=np.float32)
    masses[..., 1] = 1.0
    masses[:, 7] = (0.0, 0.0, 1.0, 0.0)
    size = round(1.0 / resolution)
    coarse = resample(
        TbmGrid(GridGeometry(0.05, 0.0, 0.0, 20, 20), masses),
        SE2.identity(),
        GridGeometry(resolution, 0, 0, size, size),
    )
    walls = np.zeros((size, size), dtype=bool)
    walls[:, int(7 * 0.05 / resolution)] = True
    np.testing.assert_array_equal(coarse.masses[..., OCCUPIED], walls)
    np.testing.assert_array_equal(coarse.masses[..., FREE], ~walls)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), theta=st.floats(-math.pi, math.pi), resolution=st.floats(0.02, 0.5))
def test_the_result_is_a_belief(seed, theta, resolution):
    result = resample(random_grid(seed), SE2(0.3, 0.1, theta), GridGeometry(resolution, -1.0, -1.0, 12, 12))
    assert np.all(result.masses >= 0.0)
    np.testing.assert_allclose(result.masses.sum(axis=-1), 1.0, atol=1e-5)


def test_there_and_back_is_within_a_cell():
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 60, 60))
    grid.masses[20:40, 20:40] = (0.0, 1.0, 0.0, 0.0)
    motion = SE2(0.537, -0.214, 0.7)
    there = resample(grid, motion, GridGeometry(0.1, -6.0, -6.0, 160, 160))
    back = resample(there, motion.inverse(), grid.geometry)
    differing = np.argwhere(np.any(back.masses != grid.masses, axis=-1))
    to_edge = np.minimum(np.abs(differing - 19.5), np.abs(differing - 39.5)).min(axis=1)
    assert np.all(to_edge <= 1.0)


def test_nonsense_is_refused():
    with pytest.raises(ValueError, match="transform and geometry must be finite, got SE2"):
        resample(random_grid(0), SE2(math.nan, 0.0, 0.0), random_grid(0).geometry)


@pytest.mark.parametrize("resolution", [0.1, 0.17])
def test_rows_are_those_of_the_whole(resolution):
    grid, motion = random_grid(4, rows=20, cols=40), SE2(0.1234, -0.0531, 2.1)
    placed = PlacedGrid(grid, motion, GridGeometry(resolution, -4.1, -1.9, 50, 60))
    whole = placed.drawn().masses
    assert (whole[..., UNKNOWN] < 1.0).any()
    for first, last in ((0, 50), (0, 1), (17, 33), (49, 50), (5, 5)):
        assert placed.masses_of_rows(first, last).tobytes() == whole[first:last].tobytes()
