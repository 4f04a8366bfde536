import argparse
import sys

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.geotiff import GeoTiffError
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.extra_files import add_extra_files, check_extra_files, write_extra_files

MAP = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 3, 4)))


def files(folder, tbm_map, *words):
    grammar = argparse.ArgumentParser()
    add_extra_files(grammar)
    write_extra_files(folder, tbm_map, grammar.parse_args(words))
    return {path.name for path in folder.iterdir()}


def test_only_what_was_asked_for_is_written_and_the_rest_of_an_older_map_goes(tmp_path):
    assert files(tmp_path, MAP) == set()
    assert files(tmp_path, MAP, "--occupancy-bag") == {"map.bag"}
    assert files(tmp_path, MAP, "--occupancy-bag", "mcap") == {"map.mcap"}
    pytest.importorskip("rasterio", reason="rasterio is not installed")
    assert files(tmp_path, MAP, "--geotiff") == {"map.tif"}


def test_what_cannot_be_written_is_told_before_the_work(monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    check_extra_files(argparse.Namespace(geotiff=False))
    with pytest.raises(GeoTiffError, match="needs rasterio, which is not installed"):
        check_extra_files(argparse.Namespace(geotiff=True))


def test_without_a_map_nothing_stays(tmp_path):
    files(tmp_path, MAP, "--occupancy-bag")
    assert files(tmp_path, None, "--occupancy-bag") == set()
