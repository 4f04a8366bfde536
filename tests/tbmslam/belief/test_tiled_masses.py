import errno
import mmap
import resource
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.belief.grid import GridGeometry, TbmGrid, occupancy_of
from tbmslam.belief.grid_resampling import PlacedGrid
from tbmslam.belief.masses import UNKNOWN
from tbmslam.belief.tiled_masses import SIDE, TiledMasses, sparse_zeros, vacuous_masses
from tbmslam.geometry.se2 import SE2


def scattered(seed, rows, cols):
    """Return masses with evidence in some patches of an unknown grid."""
    rng = np.random.default_rng(seed)
    masses = vacuous_masses(rows, cols)
    for _ in range(3):
        row, col = rng.integers(rows), rng.integers(cols)
        patch = masses[row : row + rng.integers(1, 30), col : col + rng.integers(1, 30)]
        patch[:] = rng.dirichlet(np.ones(4), size=patch.shape[:2])
    return masses


sizes = st.integers(1, 3 * SIDE + 5)


def in_tiles(grid):
    return TbmGrid(grid.geometry, TiledMasses.of(grid.masses))


def array_of(tiled):
    return tiled.window(0, tiled.shape[0], 0, tiled.shape[1])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1000), rows=sizes, cols=sizes, data=st.data())
def test_tiles_hold_what_an_array_holds(seed, rows, cols, data):
    masses = scattered(seed, rows, cols)
    tiled = TiledMasses.of(masses)
    assert array_of(tiled).tobytes() == masses.tobytes()
    np.testing.assert_array_equal(tiled.known(), masses[..., UNKNOWN] < 1.0)
    np.testing.assert_array_equal(array_of(tiled.mirrored()), masses[:, ::-1])
    top, left = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, cols - 1))
    bottom, right = data.draw(st.integers(top + 1, rows)), data.draw(st.integers(left + 1, cols))
    inside, part = masses[top:bottom, left:right], tiled.part(top, bottom, left, right)
    assert array_of(part).tobytes() == tiled.window(top, bottom, left, right).tobytes() == inside.tobytes()
    assert array_of(part.mirrored().mirrored()).tobytes() == inside.tobytes()
    assert array_of(part.part(0, part.shape[0], 0, 1)).tobytes() == inside[:, :1].tobytes()
    if (inside[..., UNKNOWN] < 1.0).any():
        assert tiled.has_evidence(top, bottom, left, right)


def test_only_tiles_with_evidence_are_stored():
    masses = vacuous_masses(10 * SIDE, 10 * SIDE)
    masses[2 * SIDE, 3 * SIDE] = (0.0, 1e-30, 0.0, 1.0)  # evidence that no sum shows
    tiled = TiledMasses.of(masses)
    assert list(tiled.tiles) == [(2, 3)]
    assert array_of(tiled).tobytes() == masses.tobytes()
    assert not tiled.has_evidence(0, 2 * SIDE, 0, 10 * SIDE)
    assert not tiled.part(0, 2 * SIDE, 0, 10 * SIDE).tiles


class WithoutLargePages(mmap.mmap):
    """The memory of a kernel that does not know large pages."""

    def madvise(self, *_):
        raise OSError(errno.EINVAL, "Invalid argument")


def without_memory(*_, **__):
    raise OSError(errno.ENOMEM, "Cannot allocate memory")


@pytest.mark.parametrize("memory", [WithoutLargePages, without_memory])
def test_zeros_are_of_numpy_where_the_system_refuses(monkeypatch, memory):
    monkeypatch.setattr(mmap, "mmap", memory)
    zeros = sparse_zeros((1 << 20, 2), np.float32)
    assert zeros.shape == (1 << 20, 2)
    assert not zeros.any()


def test_there_may_be_no_cell():
    tiled = TiledMasses.of(np.zeros((0, 0, 4), dtype=np.float32))
    assert array_of(tiled).shape == (0, 0, 4)
    assert tiled.known().shape == (0, 0)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), rows=sizes, cols=sizes)
def test_a_grid_of_tiles_is_the_grid_of_its_array(seed, rows, cols):
    dense = TbmGrid(GridGeometry(0.05, -1.0, 2.0, rows, cols), scattered(seed, rows, cols))
    tiled = in_tiles(dense)
    assert tiled.masses.tobytes() == dense.masses.tobytes()
    np.testing.assert_array_equal(tiled.is_known(), dense.is_known())
    np.testing.assert_array_equal(tiled.pignistic(), dense.pignistic())
    np.testing.assert_array_equal(occupancy_of(tiled), occupancy_of(dense))
    for one, other in (
        (tiled.mirrored(), dense.mirrored()),
        (tiled.cropped_to_known(), dense.cropped_to_known()),
        (tiled.known_part(3), dense.known_part(3)),
    ):
        assert one.geometry == other.geometry
        assert one.masses.tobytes() == other.masses.tobytes()
    half = rows // 2
    assert tiled.masses_of_rows(half, rows).tobytes() == dense.masses_of_rows(half, rows).tobytes()


def test_masses_drawn_from_tiles_cannot_be_changed():
    """A change would be lost."""
    grid = in_tiles(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4)))
    with pytest.raises(ValueError, match="read-only"):
        grid.masses[0, 0] = 0.25


@pytest.mark.parametrize("mass", [-0.1, 0.5, np.nan])
def test_wrong_masses_are_found_in_tiles(mass):
    masses = vacuous_masses(2 * SIDE, 2 * SIDE)
    masses[SIDE + 3, SIDE + 4, 0] = mass
    grid = TbmGrid(GridGeometry(0.05, 0.0, 0.0, *masses.shape[:2]), masses)
    assert in_tiles(grid).fault() == grid.fault() is not None


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
    theta=st.floats(-4.0, 4.0),
    resolution=st.sampled_from([0.03, 0.05, 0.12]),
)
def test_tiles_are_resampled_as_an_array_to_the_last_bit(seed, x, y, theta, resolution):
    grid = TbmGrid(GridGeometry(0.05, -1.5, -2.0, 90, 70), scattered(seed, 90, 70))
    target = GridGeometry(resolution, -4.0, -4.0, 300, 270)
    dense, tiled = PlacedGrid(grid, SE2(x, y, theta), target), PlacedGrid(in_tiles(grid), SE2(x, y, theta), target)
    assert tiled.drawn().masses.tobytes() == dense.drawn().masses.tobytes()
    assert tiled.masses_of_rows(17, 280).tobytes() == dense.masses_of_rows(17, 280).tobytes()


@pytest.mark.parametrize("shape", [(3, 5), (1100, 1000), (0, 4)])
def test_sparse_zeros_are_zeros_that_can_be_written(shape):
    zeros = sparse_zeros(shape, np.int64)
    assert zeros.shape == shape
    assert zeros.dtype == np.int64
    assert not zeros.any()
    zeros[-1:] = 7
    assert zeros.sum() == 7 * zeros[-1:].size
    assert not sparse_zeros(shape, np.int64, 1 << 40).any()


@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory from /proc")
def test_sparse_zeros_take_memory_only_where_they_are_written():
    def resident_mb():
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6

    before = resident_mb()
    zeros = sparse_zeros((20_000, 5_000), np.int64)
    zeros[::100, ::1000] = 1
    assert zeros.sum() == 200 * 5  # reading takes none
    assert resident_mb() - before < 40.0
