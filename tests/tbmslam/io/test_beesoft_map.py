"""Building maps as text."""

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.io.beesoft_map import read_beesoft_map
from tbmslam.map.map_check import MapFileError

WEAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "cmu-wean" / "wean.dat.gz"
# Two lines along y at x = 0 and x = 1, three cells each.
TEXT = """robot_specifications->global_mapsize_x                 20
robot_specifications->global_mapsize_y                 30
robot_specifications->resolution                       10

global_map[0]: 2 3
1.000 0.000 -1.000
0.500 0.790 0.210
"""


@pytest.fixture
def dat(tmp_path):
    path = tmp_path / "hall.dat"
    path.write_text(TEXT)
    return path


def test_lines_follow_x_and_numbers_y(dat):
    grid = read_beesoft_map(dat)
    assert grid.geometry == GridGeometry(pytest.approx(0.1), 0.0, 0.0, rows=3, cols=2)
    assert grid.masses[0, 0, FREE] == pytest.approx(0.9)
    assert grid.masses[1, 0, OCCUPIED] == pytest.approx(0.9)


def test_guesses_and_gaps_are_unknown(dat):
    masses = read_beesoft_map(dat).masses
    assert (masses[2, 0, UNKNOWN], *masses[:, 1, UNKNOWN]) == (1.0, 1.0, 1.0, 1.0)


def test_a_gzipped_map_is_the_same(dat):
    plain = read_beesoft_map(dat)
    dat.write_bytes(gzip.compress(TEXT.encode()))
    np.testing.assert_array_equal(read_beesoft_map(dat).masses, plain.masses)


@pytest.mark.skipif(not WEAN.is_file(), reason="the map of Wean Hall is not here")
def test_wean_hall():
    grid = read_beesoft_map(WEAN)
    assert grid.geometry[0] == pytest.approx(0.1)
    assert grid.geometry[3:] == (800, 800)
    assert grid.fault() is None
    area = (grid.masses.argmax(axis=-1) == FREE).sum() * 0.01
    assert 300 < area < 700  # corridors of 2 to 3 m width and 150 m length in all


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("resolution ", "revolution ", "lacks the resolution or global_map"),
        ("global_map[0]: 2 3", "global_map[0]: 2", "lacks the resolution or global_map"),
        ("global_map[0]: 2 3", "global_map[0]: 99999 99999", "more than the limit of 400000000"),
        ("resolution                       10", "resolution 0", "resolution must be positive"),
        ("resolution                       10", "resolution ten", "no number"),
        ("0.790", "much", "no number"),
        ("0.790", "nan", "must hold 2 x 3 probabilities"),
        ("0.790", "7.90", "must hold 2 x 3 probabilities"),
        ("0.210", "", "it has 5 numbers"),
        ("0.210", "\u00e9", "not the text of a Beesoft map"),
    ],
)
def test_what_is_no_such_map_is_refused(dat, old, new, message):
    assert old in TEXT
    dat.write_text(TEXT.replace(old, new), encoding="utf-8")
    with pytest.raises(MapFileError, match=message):
        read_beesoft_map(dat)


def test_a_cut_off_archive_is_refused(dat):
    dat.write_bytes(gzip.compress(TEXT.encode())[:-10])
    with pytest.raises(MapFileError, match="not the text of a Beesoft map"):
        read_beesoft_map(dat)


def test_a_missing_file_is_one_line(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.dat: cannot be read: No such file"):
        read_beesoft_map(tmp_path / "none.dat")


def test_no_more_is_unpacked_than_a_map_of_the_stated_size_can_be(dat):
    with gzip.open(dat, "wb", compresslevel=1) as file:
        file.write(TEXT.encode() + b" " * 50_000_000)
    tracemalloc.start()
    assert read_beesoft_map(dat).geometry.cols == 2
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
