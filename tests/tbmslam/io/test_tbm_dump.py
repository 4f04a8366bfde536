import lzma
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.io.tbm_dump import read_tbm_dump, write_tbm_dump
from tbmslam.map.map_check import MapFileError
from tests.merging_dump import write_merging_dump

GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "vinyslam"
WRITERS = (write_tbm_dump, write_merging_dump)


@pytest.fixture
def dump(tmp_path):
    return tmp_path / "some.tbm_map"


def some_grid(rows=3, cols=5, seed=0, geometry=(0.25, -1.0, -0.5)):
    weights = np.random.default_rng(seed).random((rows, cols, 4))
    weights[0, 0] = (0, 0, 0, 1)
    masses = (weights / weights.sum(axis=-1, keepdims=True)).astype(np.float32)
    return TbmGrid(GridGeometry(*geometry, rows, cols), masses)


def test_the_original_dump_is_the_map_that_the_original_printed():
    grid = read_tbm_dump(GOLDEN / "idle.tbm_map.xz")
    with lzma.open(GOLDEN / "idle.tbmf32.xz") as file:
        assert file.readline() == b"TBMF32\n"
        cols, rows, resolution, origin_col, origin_row = (float(word) for word in file.readline().split())
        printed = np.frombuffer(file.read(), dtype="<f4").reshape(int(rows), int(cols), 4)
    assert grid.geometry == GridGeometry(
        resolution, -origin_col * resolution, -origin_row * resolution, int(rows), int(cols)
    )
    for mass, column in ((UNKNOWN, 0), (FREE, 1), (OCCUPIED, 2), (CONFLICT, 3)):
        np.testing.assert_array_equal(grid.masses[..., mass], printed[..., column])


def test_the_original_dump_written_again_differs_by_rounding_only(dump):
    with lzma.open(GOLDEN / "idle.tbm_map.xz") as file:
        original = file.read()
    dump.write_bytes(original)
    write_tbm_dump(dump, read_tbm_dump(dump))
    written = dump.read_bytes()
    assert written[:24] == original[:24]
    cell = np.dtype([("probability", "<f8"), ("quality", "<f8"), ("is_unknown", "u1"), ("masses", "<f8", 4)])
    ours, theirs = (np.frombuffer(data, dtype=cell, offset=24) for data in (written, original))
    np.testing.assert_array_equal(ours["is_unknown"], theirs["is_unknown"])
    for field in ("quality", "masses"):
        np.testing.assert_allclose(ours[field], theirs[field], rtol=0, atol=1e-7)
    # A quotient of two small masses loses more of their digits.
    np.testing.assert_allclose(ours["probability"], theirs["probability"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("write", WRITERS)
@settings(max_examples=30, deadline=None)
@given(
    rows=st.integers(1, 7),
    cols=st.integers(1, 7),
    seed=st.integers(0, 99),
    origin=st.tuples(*[st.integers(-99, 99)] * 2),
)
def test_grids_come_back_bit_for_bit(tmp_path_factory, write, rows, cols, seed, origin):
    path = tmp_path_factory.mktemp("dump") / "map.tbm_map"
    grid = some_grid(rows, cols, seed, (0.1, origin[0] * 0.1, origin[1] * 0.1))
    write(path, grid)
    again = read_tbm_dump(path)
    np.testing.assert_array_equal(again.masses, grid.masses)
    assert again.geometry == grid.geometry


def test_an_origin_between_cells_is_rounded_to_the_nearest_cell(dump):
    write_tbm_dump(dump, some_grid(geometry=(0.25, -1.1, 0.6)))
    geometry = read_tbm_dump(dump).geometry
    assert (geometry.origin_x, geometry.origin_y) == (-1.0, 0.5)


def test_dumps_packed_by_xz_are_read(dump):
    write_tbm_dump(dump, some_grid())
    dump.write_bytes(lzma.compress(dump.read_bytes()))
    np.testing.assert_array_equal(read_tbm_dump(dump).masses, some_grid().masses)


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("length", [1, 23, 25, 70, -1])
def test_a_dump_cut_off_anywhere_is_refused(dump, write, length):
    write(dump, some_grid())
    dump.write_bytes(dump.read_bytes()[:length])
    with pytest.raises(MapFileError, match=r"some\.tbm_map.*cut off"):
        read_tbm_dump(dump)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ((100_000, 100_000, 0.1, 0, 0), "more than the limit of 400000000"),
        ((2**31 - 1, 2**31 - 1, 0.1, 0, 0), "more than the limit of 400000000"),
        ((-3, -5, 0.1, 0, 0), "cells is empty"),
        ((3, 5, 0.0, 0, 0), "resolution must be positive"),
        ((3, 5, float("nan"), 0, 0), "resolution must be positive"),
        ((3, 6, 0.1, 0, 0), "has 735 bytes for 3 x 6 cells"),
    ],
)
def test_impossible_headers_are_refused(dump, header, message):
    write_tbm_dump(dump, some_grid())
    dump.write_bytes(struct.pack("<iidii", *header) + dump.read_bytes()[24:])
    with pytest.raises(MapFileError, match=message):
        read_tbm_dump(dump)


@pytest.mark.parametrize(
    ("mass", "message"), [(-0.5, "not zero or more"), (0.9, "miss the sum"), (np.nan, "a mass"), (1e300, "sum of 1")]
)
def test_masses_that_are_no_belief_are_refused(dump, mass, message):
    write_tbm_dump(dump, some_grid())
    content = bytearray(dump.read_bytes())
    struct.pack_into("<d", content, 24 + 49 + 17, mass)
    dump.write_bytes(content)
    with pytest.raises(MapFileError, match=message):
        read_tbm_dump(dump)


def test_damage_in_the_compressed_cells_is_noticed(dump):
    write_merging_dump(dump, some_grid())
    content = bytearray(dump.read_bytes())
    content[60] ^= 0xFF
    dump.write_bytes(content)
    with pytest.raises(MapFileError, match="LZ4 frame is damaged"):
        read_tbm_dump(dump)


def test_an_lz4_frame_that_swells_is_not_unpacked(dump):
    bomb = lz4.frame.compress(bytes(10_000_000))
    dump.write_bytes(struct.pack("<iidii", 3, 5, 0.1, 0, 0) + bomb)
    with pytest.raises(MapFileError, match="does not end where its cells do"):
        read_tbm_dump(dump)


def test_damaged_xz_is_refused(dump):
    write_tbm_dump(dump, some_grid())
    dump.write_bytes(lzma.compress(dump.read_bytes())[:-40])
    with pytest.raises(MapFileError, match="damaged xz file"):
        read_tbm_dump(dump)


def test_a_missing_dump_is_one_line(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.tbm_map: cannot be read: No such file"):
        read_tbm_dump(tmp_path / "none.tbm_map")


def test_what_the_format_cannot_hold_is_a_wrong_argument(dump):
    with pytest.raises(ValueError, match=r"origin must lie within 2\^31 cells"):
        write_tbm_dump(dump, some_grid(geometry=(0.01, 1e9, 0.0)))
