import argparse
import sys

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io.geotiff import GeoTiffError
from tbmslam.map.tbm_map import TbmMap
from tools.command_line.paths import add_extra_files, check_extra_files, list_maps, write_extra_files

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


def test_a_folder_of_maps_stands_for_them_in_the_order_of_their_numbers(tmp_path):
    for name in ("robot_10", "robot_9", "robot_0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "map.npz").touch()
    (tmp_path / "notes").mkdir()
    (tmp_path / "hall").mkdir()
    (tmp_path / "hall" / "map.yaml").touch()
    found = list_maps([tmp_path / "robot_9", tmp_path, tmp_path / "none.yaml"])
    assert [path.name for path in found] == ["robot_9", "hall", "robot_0", "robot_9", "robot_10", "none.yaml"]


def test_a_folder_without_maps_is_left_for_the_reader_to_refuse(tmp_path):
    assert list_maps([tmp_path]) == [tmp_path]
