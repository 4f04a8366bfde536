import sys

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.atomic_file import FileNotWrittenError
from tbmslam.io.geotiff import BANDS, GeoTiffError, write_geotiff

GEOMETRY = GridGeometry(0.1, -1.0 / 3.0, 7.0, 21, 13)


@pytest.fixture
def grid():
    masses = np.random.default_rng(0).dirichlet(np.ones(4), size=(21, 13)).astype(np.float32)
    return TbmGrid(GEOMETRY, masses)


def test_rasterio_reads_every_cell_at_its_place(grid, tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed")
    write_geotiff(tmp_path / "map.tif", grid)
    with rasterio.open(tmp_path / "map.tif") as file:
        assert tuple(file.bounds) == pytest.approx(GEOMETRY.bounds())
        assert file.descriptions == BANDS
        assert file.crs is not None
        assert not file.crs.is_geographic
        for row, col in ((0, 0), (20, 12), (5, 9)):
            (values,) = file.sample([GEOMETRY.centre_of(row, col)])
            conflict, free, occupied, unknown = grid.masses[row, col]
            expected = (grid.pignistic()[row, col], free, occupied, unknown, conflict)
            np.testing.assert_allclose(values, expected, rtol=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == ["map.tif"]


def test_the_same_grid_gives_the_same_bytes(grid, tmp_path):
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    for name in ("a.tif", "b.tif"):
        write_geotiff(tmp_path / name, grid)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_the_error_without_rasterio_names_the_package(grid, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(GeoTiffError, match=r"needs rasterio, which is not installed: pip install 'tbmslam\[geotiff\]'"):
        write_geotiff(tmp_path / "map.tif", grid)


def test_a_place_that_cannot_be_written_is_named(grid, tmp_path):
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(FileNotWrittenError, match=r"map\.tif: cannot be written"):
        write_geotiff(tmp_path / "taken" / "map.tif", grid)
