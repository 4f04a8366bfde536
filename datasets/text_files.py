"""Lines of text files, compressed or not."""

import bz2
import gzip
import lzma
import zlib
from collections.abc import Iterator
from io import BufferedIOBase
from pathlib import Path

from datasets.errors import DatasetError

_FAULTS = (OSError, EOFError, zlib.error, lzma.LZMAError)
_OPENERS = ((b"\x1f\x8b", gzip.open), (b"BZh", bz2.open), (b"\xfd7zXZ\0", lzma.open))
_LONGEST_LINE = 1 << 22  # a few bytes may be decompressed to a line that fills the memory


def first_bytes(path: Path) -> bytes:
    """Return the beginning of a file, decompressed if needed; raise a `DatasetError` if that fails."""
    try:
        with open_unpacked(path) as stream:
            return stream.read(4096)
    except _FAULTS as error:
        raise _damaged(path, error) from error


def lines_of(path: Path) -> Iterator[str]:
    """Yield the lines of a text file, plain or compressed by gzip, bzip2 or xz; lines of many megabytes in pieces."""
    try:
        with _opener(path)(path, "rt", encoding="latin-1") as stream:
            while line := stream.readline(_LONGEST_LINE):
                yield line
    except _FAULTS as error:
        raise _damaged(path, error) from error


def is_packed(path: Path) -> bool:
    """Return by its first bytes whether a file is compressed by gzip, bzip2 or xz."""
    return _opener(path) is not open


def open_unpacked(path: Path) -> BufferedIOBase:
    """Open a file for its bytes behind the compression."""
    stream: BufferedIOBase = _opener(path)(path, "rb")
    return stream


def _opener(path: Path):  # type: ignore[no-untyped-def]  # the openers' overloads have no common type
    """Return the function that opens a file, by its first bytes."""
    with path.open("rb") as stream:
        head = stream.read(8)
    return next((opener for magic, opener in _OPENERS if head.startswith(magic)), open)


def _damaged(path: Path, error: Exception) -> DatasetError:
    """Return the error for a file that cannot be read to its end."""
    return DatasetError(f"{path}: cannot be read to its end ({error}): fetch the file again")
