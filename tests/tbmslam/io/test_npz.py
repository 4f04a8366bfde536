import contextlib
import tracemalloc
import zipfile

import numpy as np
import pytest

from tbmslam.io.map_npz import ArrayZip, NpzError, write_npz
from tests.processes import python

ARRAYS = {
    "numbers": np.arange(12.0).reshape(3, 4),
    "fortran": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
    "view": np.arange(20)[::2],
    "scalar": np.array(7),
    "text": np.array("für {}"),
    "none": np.zeros((0, 3)),
}


def entry(path, name):
    with zipfile.ZipFile(path) as archive:
        return archive.read(f"{name}.npy")


def replaced(path, name, content, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path) as archive:
        entries = {info.filename: archive.read(info) for info in archive.infolist()}
    entries[f"{name}.npy"] = content
    with zipfile.ZipFile(path, "w", compression) as archive:
        for filename, data in entries.items():
            archive.writestr(filename, data)


@pytest.fixture
def path(tmp_path):
    write_npz(tmp_path / "a.npz", ARRAYS)
    return tmp_path / "a.npz"


def test_what_is_written_is_read(path):
    with ArrayZip(path) as arrays:
        for name, values in ARRAYS.items():
            found = arrays.read(name, values.dtype, values.shape)
            assert found.dtype == values.dtype
            assert found.flags.c_contiguous
            np.testing.assert_array_equal(found, values)


def test_numpy_reads_it(path):
    with np.load(path, allow_pickle=False) as archive:
        assert archive.files == list(ARRAYS)
        np.testing.assert_array_equal(archive["fortran"], ARRAYS["fortran"])


def test_the_same_arrays_give_the_same_bytes(path, tmp_path):
    write_npz(tmp_path / "b.npz", ARRAYS)
    assert (tmp_path / "b.npz").read_bytes() == path.read_bytes()


def test_any_length_is_taken_where_none_is_given(path):
    with ArrayZip(path) as arrays:
        assert arrays.shape("numbers", np.float64, (None, 4)) == (3, 4)
        assert arrays.read("none", np.float64, (None, 3)).shape == (0, 3)


def test_objects_are_neither_written_nor_read(path, tmp_path):
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        write_npz(tmp_path / "o.npz", {"o": np.array([None])})
    assert not (tmp_path / "o.npz").exists()
    np.savez(tmp_path / "o.npz", o=np.array([print]))
    with ArrayZip(tmp_path / "o.npz") as arrays, pytest.raises(NpzError, match="o is of type object, not float64"):
        arrays.read("o", np.float64, (1,))


@pytest.mark.parametrize(
    ("name", "dtype", "shape", "message"),
    [
        ("missing", np.float64, (1,), "it has no missing"),
        ("numbers", np.float32, (3, 4), "numbers is of type float64, not float32"),
        ("numbers", np.str_, (3, 4), "numbers is of type float64, not <U0"),
        ("text", np.float64, (), "text is of type <U6, not float64"),
        ("numbers", np.float64, (3,), r"numbers has shape \(3, 4\), not 3"),
        ("numbers", np.float64, (None, 5), r"numbers has shape \(3, 4\), not any x 5"),
        ("numbers", np.float64, (), "not that of a single value"),
    ],
)
def test_what_is_not_as_expected_is_refused(path, name, dtype, shape, message):
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match=message):
        arrays.read(name, dtype, shape)


def header(shape, dtype="<f8"):
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (header((10**12,)) + bytes(96), "states 8000000000[0-9]+ bytes but does not hold them"),
        (header((12,)) + bytes(95), "states .* bytes but does not hold them"),
        (header((12,)) + bytes(97), "states .* bytes but does not hold them"),
        (b"\x93NUMPY\x02\x00", r"has a header of version \(2, 0\)"),
        (b"no array", "numbers cannot be read"),
        (b"", "numbers cannot be read"),
        (header("(12,") + bytes(96), "numbers cannot be read"),
    ],
)
def test_headers_that_lie_are_refused(path, content, message):
    replaced(path, "numbers", content)
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match=message):
        arrays.read("numbers", np.float64, (None,))


def test_a_size_the_archive_cannot_hold_is_refused_before_memory_is_taken(path):
    """The directory of the archive lies as well, so that the array's header agrees with it."""
    content = header((10**9,)) + bytes(96)
    replaced(path, "numbers", content, zipfile.ZIP_STORED)
    size, claimed = len(content).to_bytes(4, "little"), (len(content) - 96 + 8 * 10**9) % 2**32
    data = bytearray(path.read_bytes())
    directory = data.rindex(b"numbers.npy") - 46
    assert data[directory + 24 : directory + 28] == size
    data[directory + 24 : directory + 28] = claimed.to_bytes(4, "little")
    path.write_bytes(data)
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match="does not hold them"):
        arrays.read("numbers", np.float64, (None,))


@pytest.mark.parametrize(("dtype", "shape"), [("<f8", (None,)), ("<U20000000", ())])
def test_what_unpacks_to_far_more_than_it_should_is_no_array(path, dtype, shape):
    length = np.dtype(dtype).itemsize if shape == () else 80_000_000
    content = header("()" if shape == () else f"({length // 8},)", dtype) + bytes(length)
    replaced(path, "numbers", content, zipfile.ZIP_DEFLATED)
    tracemalloc.start()
    with (
        ArrayZip(path) as arrays,
        pytest.raises(NpzError, match=r"numbers would unpack from \d+ to 8\d+ bytes, like a"),
    ):
        arrays.read("numbers", dtype, shape)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_a_changed_byte_is_noticed(path):
    replaced(path, "numbers", entry(path, "numbers"), zipfile.ZIP_STORED)
    data = bytearray(path.read_bytes())
    data[data.index(np.float64(11.0).tobytes())] ^= 1
    path.write_bytes(data)
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match=r"numbers cannot be read .*CRC"):
        arrays.read("numbers", np.float64, (None, None))


def test_text_of_no_characters_is_refused(path):
    replaced(path, "text", header("()", "<U1") + b"\xff\xff\xff\xff")
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match="text is damaged text"):
        arrays.read("text", np.str_, ())


def test_other_ways_of_packing_are_refused(path):
    replaced(path, "numbers", entry(path, "numbers"), zipfile.ZIP_LZMA)
    with ArrayZip(path) as arrays, pytest.raises(NpzError, match="a compression that numpy does not use"):
        arrays.read("numbers", np.float64, (3, 4))


def test_what_is_no_archive_is_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK no zip")
    with pytest.raises(NpzError, match="it is no zip file"):
        ArrayZip(tmp_path / "a.npz")
    with pytest.raises(NpzError, match=r"it cannot be read \(No such file"):
        ArrayZip(tmp_path / "b.npz")


def read_all(path):
    with ArrayZip(path) as arrays:
        for name, values in ARRAYS.items():
            arrays.read(name, values.dtype, values.shape)


@pytest.mark.filterwarnings("ignore:Reading `.npy`")  # numpy tells of headers that a very old Python wrote
def test_any_damage_is_a_known_error(path):
    good = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(150):
        data = bytearray(good)
        for place in rng.integers(0, len(data), size=3):
            data[place] = rng.integers(0, 256)
        path.write_bytes(data[: rng.integers(1, len(data)) if rng.random() < 0.2 else None])
        with contextlib.suppress(NpzError):
            read_all(path)


INTERRUPTED_WRITING = """
import sys, zipfile
import numpy as np
from tbmslam.io.map_npz import write_npz

def interrupted(entry):
    raise KeyboardInterrupt

zipfile._ZipWriteFile.close = interrupted
try:
    write_npz(sys.argv[1], {"a": np.zeros(3)})
except KeyboardInterrupt:
    raise SystemExit(130)
"""


def test_an_interruption_while_an_entry_ends_is_heard(tmp_path):
    assert python("-c", INTERRUPTED_WRITING, tmp_path / "arrays.npz").returncode == 130
    assert list(tmp_path.iterdir()) == []
