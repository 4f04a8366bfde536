import argparse
import sys

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.geotiff import GeoTiffError
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.extra_files import add_extra_files, check_extra_files, write_extra_files

MAP = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 3, 4)))
LARGER = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 5, 6)))


def files(folder, tbm_map, *words):
    grammar = argparse.ArgumentParser()
    add_extra_files(grammar)
    folder.mkdir(exist_ok=True)
    write_extra_files(folder, tbm_map, grammar.parse_args(words))
    return {path.name for path in folder.iterdir()}


def test_only_the_files_that_were_asked_for_are_written(tmp_path):
    assert files(tmp_path, MAP) == set()
    assert files(tmp_path, MAP, "--occupancy-bag") == {"map.bag"}


def test_files_of_an_earlier_run_show_the_new_map(tmp_path):
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    written = files(tmp_path / "first", MAP, "--geotiff", "--occupancy-bag", "mcap")
    assert files(tmp_path / "fresh", LARGER, "--geotiff", "--occupancy-bag", "mcap") == written
    assert files(tmp_path / "first", LARGER) == written
    for name in written:
        fresh, again = ((tmp_path / folder / name).read_bytes() for folder in ("fresh", "first"))
        assert again == fresh, name


def test_another_kind_of_bag_keeps_the_first(tmp_path):
    files(tmp_path, MAP, "--occupancy-bag")
    assert files(tmp_path, LARGER, "--occupancy-bag", "mcap") == {"map.bag", "map.mcap"}


def test_an_outdated_geotiff_is_removed_with_a_warning(tmp_path, monkeypatch, caplog):
    (tmp_path / "map.tif").write_bytes(b"an older map")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert files(tmp_path, MAP) == set()
    assert "map.tif shows an older map and was removed: a GeoTIFF needs rasterio" in caplog.text


def test_an_unwritable_file_is_reported_before_the_work(monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    check_extra_files(argparse.Namespace(geotiff=False))
    with pytest.raises(GeoTiffError, match="needs rasterio, which is not installed"):
        check_extra_files(argparse.Namespace(geotiff=True))


def test_without_a_map_nothing_stays(tmp_path):
    files(tmp_path, MAP, "--occupancy-bag")
    assert files(tmp_path, None, "--occupancy-bag") == set()
