import math

import numpy as np
import pytest

from merging.fusion.warping import at_resolution, canvas_over, offset_in, warp, window_over
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import UNKNOWN
from tbmslam.geometry.se2 import SE2

LATTICE = GridGeometry(0.1, -0.35, 0.2, 5, 5)


def block(rows, cols, resolution=0.1, origin=(0.0, 0.0), margin=0):
    grid = TbmGrid.unknown(GridGeometry(resolution, *origin, rows + 2 * margin, cols + 2 * margin))
    grid.masses[margin : margin + rows, margin : margin + cols] = (0.0, 0.25, 0.5, 0.25)
    return grid


def test_the_same_frame_and_lattice_change_nothing():
    grid = block(6, 9, margin=3)
    warped = warp(grid, SE2.identity(), grid.geometry)
    assert warped.geometry == grid.cropped_to_known().geometry
    assert warped.masses.tobytes() == grid.cropped_to_known().masses.tobytes()


@pytest.mark.parametrize("theta", [0.3, 1.2, math.pi / 2, -2.5])
@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.1])
def test_no_evidence_is_cut_off(theta, resolution):
    grid = block(20, 30, resolution, origin=(-5.0, 2.0), margin=4)
    warped = warp(grid, SE2(-3.3, 8.8, theta), LATTICE)
    evidence = np.sum(1.0 - warped.masses[..., UNKNOWN]) * 0.1**2
    assert evidence == pytest.approx(0.75 * 600 * resolution**2, rel=0.15)
    assert offset_in(LATTICE, warped.geometry)  # on the lattice, wherever it lies


def test_a_window_over_whole_cells_has_no_extra_rows():
    geometry = GridGeometry(0.1, 0.3, 0.3, 4, 6)
    lattice = GridGeometry(0.1, -7.7, 12.1, 3, 3)
    window = window_over(geometry, SE2(0.4, -0.2, math.pi / 2), lattice)
    assert (window.rows, window.cols) == (6, 4)


def test_another_resolution_keeps_the_place():
    grid = block(20, 30, 0.05, origin=(1.0, -2.0), margin=2)
    coarse = at_resolution(grid, 0.1)
    assert coarse.geometry.resolution == 0.1
    assert coarse.is_known().sum() == 150
    assert coarse.geometry.bounds() == pytest.approx(grid.cropped_to_known().geometry.bounds())
    assert at_resolution(grid, 0.05).masses.shape == (20, 30, 4)


def test_a_canvas_covers_all_windows():
    windows = [GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.1, -0.3, 0.2, 6, 2)]
    canvas = canvas_over(windows)
    assert canvas == pytest.approx(GridGeometry(0.1, -0.3, 0.0, 8, 8))
    assert [offset_in(canvas, window) for window in windows] == [(0, 3), (2, 0)]


def test_windows_off_the_lattice_are_refused():
    with pytest.raises(ValueError, match="cut from one lattice of cells"):
        canvas_over([GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.1, 0.05, 0.0, 4, 5)])
    with pytest.raises(ValueError, match="cut from one lattice of cells"):
        offset_in(GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.2, 0.0, 0.0, 4, 5))
    with pytest.raises(ValueError, match="windows must not be empty"):
        canvas_over([])


def test_cells_nobody_saw_stay_unknown():
    warped = warp(block(10, 10), SE2(0.0, 0.0, 0.5), LATTICE)
    assert np.all(warped.masses[0, 0] == (0.0, 0.0, 0.0, 1.0))
    assert np.all(warped.masses[..., UNKNOWN][~warped.is_known()] == 1.0)


@pytest.mark.parametrize("stretch", [0.0, 5e-7, 1.5e-6, 5e-6, 1e-4])
def test_a_grid_brought_to_a_cell_size_can_be_laid_on_a_lattice_of_it(stretch):
    grid = block(20, 30, 0.05, origin=(1.0, -2.0), margin=2)
    lattice = grid.cropped_to_known().geometry._replace(resolution=0.05 * (1.0 + stretch))
    assert offset_in(lattice, at_resolution(grid, lattice.resolution).geometry) == (0, 0)
