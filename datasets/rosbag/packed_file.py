"""Bags that are packed as a whole, as data sets publish them: rosbags seeks in a bag, so it is unpacked first."""

import contextlib
import lzma
import os
import shutil
import tempfile
import zlib
from io import BufferedIOBase
from pathlib import Path
from typing import NamedTuple

from datasets.errors import DatasetError
from datasets.text_files import is_packed, open_unpacked

_PIECE = 1 << 20  # bytes that are unpacked at a time
_folders: dict[int, tempfile.TemporaryDirectory[str]] = {}
"""Where this process unpacks, by its number; removed when it ends."""
_known: dict[tuple[str, int, int], "UnpackedFile"] = {}


class UnpackedFile(NamedTuple):
    """A file as it can be read.

    Parameters
    ----------
    path
        The file itself where it is not packed, else one that is removed when the program ends.
    damage
        What is wrong with the packing: the file ends where that shows.
    """

    path: Path
    damage: str | None = None


def unpacked(path: Path) -> UnpackedFile:
    """Return a file whose content is not packed by gzip, bzip2 or xz; a folder stays as it is.

    Raises
    ------
    DatasetError
        There is no room for the content.
    OSError
        The file cannot be read.
    """
    if path.is_dir() or not is_packed(path):
        return UnpackedFile(path)
    state = path.stat()
    key = os.fspath(path.resolve()), state.st_size, state.st_mtime_ns
    if key not in _known or not _known[key].path.exists():
        _known[key] = _unpack(path)
    return _known[key]


def _unpack(path: Path) -> UnpackedFile:
    if os.getpid() not in _folders:
        _folders[os.getpid()] = tempfile.TemporaryDirectory(prefix="tbmslam-")
    folder = Path(tempfile.mkdtemp(dir=_folders[os.getpid()].name))
    content, damage = folder / path.stem, None
    try:
        with open_unpacked(path) as packed, content.open("wb") as whole:
            while piece := _next_piece(packed):
                if isinstance(piece, str):
                    damage = piece
                    break
                whole.write(piece)
    except OSError as error:
        with contextlib.suppress(OSError):
            shutil.rmtree(folder)
        raise DatasetError(
            f"{path}: cannot be unpacked into {folder.parent} ({error.strerror}): make room, or set TMPDIR to a folder "
            "with room"
        ) from error
    return UnpackedFile(content, damage)


def _next_piece(packed: BufferedIOBase) -> bytes | str:
    """Return the next bytes, none at the end; or what is wrong with the packing."""
    try:
        return packed.read1(_PIECE)  # of a cut file all that is there
    except EOFError:
        return "the packed file is cut off"
    except (OSError, zlib.error, lzma.LZMAError) as error:
        return f"the packed file is damaged ({error})"
