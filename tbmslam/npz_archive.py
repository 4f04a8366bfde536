"""NumPy's .npz archives with the same bytes for the same arrays, read without trusting what they declare."""

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tbmslam.map_check import MAX_CELLS, MapFileError

_MAX_BYTES = MAX_CELLS * 16
_DAMAGE = (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error, MemoryError, OverflowError)
"""What zipfile and numpy raise on damaged archives; NotImplementedError is among the RuntimeErrors."""


def write_npz(file: BinaryIO, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write arrays as `np.load` reads them; members carry no time, so the bytes depend on the arrays alone."""
    # Level 1 takes a third of level 6's time and gives files that are hardly larger: most cells are unknown.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=array.nbytes >= 1 << 30) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


class NpzReader:
    """Reads the members of an archive, each checked before memory is taken for it.

    A context manager; whatever goes wrong is a `MapFileError`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
        except _DAMAGE as error:
            raise MapFileError(f"{path}: is no npz archive ({error}): make the map again") from error

    def __enter__(self) -> "NpzReader":
        """Return the reader."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the archive."""
        self._archive.close()

    def __contains__(self, name: str) -> bool:
        """Tell whether there is a member of this name."""
        return f"{name}.npy" in self._archive.namelist()

    def array(self, name: str, dtype: npt.DTypeLike, shape: tuple[int | None, ...]) -> npt.NDArray[Any]:
        """Return a member that must have this type and shape; None stands for any length.

        Raises
        ------
        MapFileError
            If the member is missing, damaged, or of another type, shape or size.
        """
        found_dtype, found_shape = self._declared(name)
        fits = len(shape) == len(found_shape) and all(w in (None, f) for w, f in zip(shape, found_shape, strict=True))
        if found_dtype != np.dtype(dtype) or not fits:
            raise MapFileError(
                f"{self.path}: {name} must be {np.dtype(dtype)} of shape {shape}, it is {found_dtype} of shape "
                f"{found_shape}: make the map again"
            )
        return np.asarray(self._read(name), order="C")

    def text(self, name: str) -> str:
        """Return a member that must be one text."""
        found_dtype, found_shape = self._declared(name)
        if found_dtype.kind != "U" or found_shape != ():
            raise MapFileError(f"{self.path}: {name} must be a text, it is {found_dtype}: make the map again")
        return str(self._read(name))

    def _declared(self, name: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
        """Return type and shape as the member's header states them, once they agree with the member's size."""
        try:
            info = self._archive.getinfo(f"{name}.npy")
            with self._archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                read_header = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = read_header(member)
                declared = int(np.prod(shape, dtype=object)) * dtype.itemsize
                agrees = member.tell() + declared == info.file_size
        except KeyError:
            raise MapFileError(f"{self.path}: holds no {name}: it is no map of this program or damaged") from None
        except _DAMAGE as error:
            raise self._damaged(name, error) from error
        if not agrees or declared > _MAX_BYTES or dtype.hasobject:
            raise MapFileError(f"{self.path}: {name} declares {dtype} of shape {shape}, which cannot be: it is damaged")
        return dtype, shape

    def _read(self, name: str) -> npt.NDArray[Any]:
        try:
            with self._archive.open(f"{name}.npy") as member:
                array = np.lib.format.read_array(member, allow_pickle=False)
                member.read(1)  # the checksum is compared at the end of the member
        except _DAMAGE as error:
            raise self._damaged(name, error) from error
        return array

    def _damaged(self, name: str, error: BaseException) -> MapFileError:
        return MapFileError(f"{self.path}: {name} cannot be read ({error}): the file is damaged, make the map again")
