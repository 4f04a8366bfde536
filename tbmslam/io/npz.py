"""Zips of arrays in numpy's format: written reproducibly, and checked when read."""

import math
import os
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.io.atomic_file import replacing

Array = npt.NDArray[Any]
_DEFLATE_LIMIT = 1040
"""Largest compression ratio of deflate; a file with a larger ratio states wrong sizes."""

_FREE_BYTES, _USUAL_RATIO = 64_000_000, 100
"""Size above which an array of unknown length with a better compression than the numbers of a drive is refused."""

_LONGEST_REASON = 120


class NpzError(TbmSlamError):
    """A file is not a zip of the expected arrays."""


def write_npz(
    path: str | os.PathLike[str], arrays: dict[str, Array], make_way: Callable[[], object] | None = None
) -> None:
    """Write named arrays atomically in the given order for `numpy.load`; see `replacing`.

    Raises
    ------
    ValueError
        If an array holds Python objects.
    """
    try:
        with (
            replacing(path, make_way) as temporary,
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        ):
            for name, values in arrays.items():
                # An entry that is opened by its name gets the zip epoch as its time, so equal arrays give equal bytes.
                with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                    np.lib.format.write_array(stream, values, allow_pickle=False)
    except ValueError as error:
        # An archive that is interrupted at the end of an entry cannot be closed; the error would hide the interruption.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise


class ArrayZip:
    """A file of named arrays, opened for reading.

    Raises
    ------
    NpzError
        The file cannot be read or is no zip.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            self._archive = zipfile.ZipFile(path)
        except OSError as error:
            raise NpzError(f"it cannot be read ({error.strerror or error})") from error
        except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error) as error:
            raise NpzError(f"it is no zip file ({_shortened(error)})") from error

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close the file."""
        self._archive.close()

    def __contains__(self, name: str) -> bool:
        """Return whether the file has an array of this name."""
        return f"{name}.npy" in self._archive.namelist()

    def shape(self, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> tuple[int, ...]:
        """Return the shape of an array by its header, after checks that do not read the array.

        Parameters
        ----------
        dtype, shape
            The expected shape; None stands for any length.

        Raises
        ------
        NpzError
            The array is missing, of another type or shape, or its size is not that of its data.
        """
        with self._entry(name) as (stream, info):
            return _checked_shape(stream, info, name, dtype, shape)

    def read(self, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> Array:
        """Return an array; see `shape` for the arguments and errors.

        Implausibly large arrays are refused if the expected shape has an open size.
        """
        self.shape(name, dtype, shape)
        with self._entry(name) as (stream, info):
            if None in shape or np.dtype(dtype).kind == "U":
                _check_ratio(name, info)
            values = np.lib.format.read_array(stream, allow_pickle=False)
            stream.read(1)  # the checksum is compared at the end of an entry
            # numpy accepts strings with invalid code points, on which Python fails later.
            if values.dtype.kind == "U" and np.any(np.frombuffer(values.tobytes(), dtype=np.uint32) > sys.maxunicode):
                raise NpzError(f"{name} is damaged text")
            return np.ascontiguousarray(values).reshape(values.shape)

    @contextmanager
    def _entry(self, name: str) -> Iterator[tuple[IO[bytes], zipfile.ZipInfo]]:
        """Open the bytes of an array; every error while they are read is an NpzError."""
        try:
            info = self._archive.getinfo(f"{name}.npy")
            with self._archive.open(info) as stream:
                yield stream, info
        except KeyError:
            raise NpzError(f"it has no {name}") from None
        except NpzError:
            raise
        # Damaged zips and headers raise many types, also tokenize.TokenError and SystemError.
        except Exception as error:
            raise NpzError(f"{name} cannot be read ({_shortened(error)})") from error


def _check_ratio(name: str, info: zipfile.ZipInfo) -> None:
    if info.file_size > _FREE_BYTES + _USUAL_RATIO * info.compress_size:
        raise NpzError(f"{name} would unpack from {info.compress_size} to {info.file_size} bytes, like a zip bomb")


def _shortened(error: Exception) -> str:
    """Return the shortened text of an error, since libraries may quote the rest of the file."""
    return " ".join(str(error).split())[:_LONGEST_REASON]


def _checked_shape(
    stream: IO[bytes], info: zipfile.ZipInfo, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]
) -> tuple[int, ...]:
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise NpzError(f"{name} has a compression that numpy does not use")
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise NpzError(f"{name} has a header of version {version}, not 1.0")
    found_shape, _, found_dtype = np.lib.format.read_array_header_1_0(stream)
    expected = np.dtype(dtype)
    # The length of texts is free.
    if found_dtype != expected and (found_dtype.kind != "U" or expected.kind != "U" or not found_dtype.isnative):
        raise NpzError(f"{name} is of type {found_dtype}, not {expected}")
    agrees = len(found_shape) == len(shape) and all(
        wanted in {None, found} for found, wanted in zip(found_shape, shape, strict=True)
    )
    if not agrees:
        wanted = " x ".join("any" if length is None else str(length) for length in shape)
        raise NpzError(f"{name} has shape {found_shape}, not {wanted or 'that of a single value'}")
    size = stream.tell() + math.prod(found_shape) * found_dtype.itemsize
    if size != info.file_size or size > _DEFLATE_LIMIT * (info.compress_size + 64):
        raise NpzError(f"{name} states {size} bytes but does not hold them")
    return found_shape
