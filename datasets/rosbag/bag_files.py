"""The files of a bag: their listing, the check that they are complete, and their decompression."""

import contextlib
import lzma
import os
import re
import shutil
import tempfile
import zlib
from io import BufferedIOBase
from pathlib import Path
from typing import NamedTuple

from datasets.errors import DatasetError
from datasets.text_files import is_packed, open_unpacked
from tbmslam.special_file import why_unreadable

STORAGE_SUFFIXES = (".db3", ".mcap")


def is_ros1(path: Path) -> bool:
    """Return whether a file is a ROS 1 bag."""
    if path.is_dir():
        return False
    with path.open("rb") as stream:
        return stream.read(4) == b"#ROS"


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a ROS 2 bag's directory in the order of writing: 10 comes after 9."""
    files = [entry for entry in folder.iterdir() if entry.suffix in STORAGE_SUFFIXES]
    # The parts of a name are text and numbers, by turns.
    return sorted(files, key=lambda file: [int(p) if p.isdecimal() else p for p in re.split(r"(\d+)", file.name)])


_LOG_HEADER = 32  # bytes of a write-ahead log without content


def log_of(file: Path) -> Path | None:
    """Return the write-ahead log of a database, in which a recorder that was interrupted leaves the last messages."""
    if file.suffix != ".db3":
        return None
    for place in (os.fspath(file), os.path.realpath(file)):
        log = Path(f"{place}-wal")
        if log.is_file() and log.stat().st_size > _LOG_HEADER:
            return log
    return None


class CutFileError(ValueError):
    """A file of a bag ends too soon."""


def check_files(path: Path) -> None:
    """Refuse a database that is shorter than it states: sqlite would read zeros where its last page is cut off.

    Files that appear empty are refused too, since some files of the system do and reading them might never end.
    """
    for file in [path / "metadata.yaml", *storage_files(path)] if path.is_dir() else [path]:
        if why := why_unreadable(file):
            raise CutFileError(f"{file.name} {why}")
        if not file.is_file() or (path.is_dir() and log_of(file)):  # with logs, a folder's files are read one by one
            continue
        with file.open("rb") as stream:
            head = stream.read(100)
        if not head.startswith(b"SQLite format 3\0") or head[24:28] != head[92:96]:  # an older sqlite states no size
            continue
        page = int.from_bytes(head[16:18], "big")
        stated = int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page)
        size = file.stat().st_size
        if size < stated:
            raise CutFileError(f"the database is cut off, {size} of {stated} bytes are there")


_PIECE = 1 << 20  # bytes that are unpacked at a time
_folders: dict[int, tempfile.TemporaryDirectory[str]] = {}
"""Folder of unpacked files by the number of the process; removed at its end."""
_known: dict[tuple[str, int, int], "UnpackedFile"] = {}


class UnpackedFile(NamedTuple):
    """A file as it can be read."""

    path: Path
    """The file itself if it is not compressed, else a temporary file that is removed when the program ends."""
    damage: str | None = None
    """Damage of the compressed data, at which the file ends."""


def unpacked(path: Path) -> UnpackedFile:
    """Return a file whose content is not packed by gzip, bzip2 or xz; a folder stays as it is."""
    if path.is_dir() or not is_packed(path):
        return UnpackedFile(path)
    state = path.stat()
    key = os.fspath(path.resolve()), state.st_size, state.st_mtime_ns
    if key not in _known or not _known[key].path.exists():
        _known[key] = _unpack(path)
    return _known[key]


def temporary_folder() -> Path:
    """Return a new folder that is removed when the program ends."""
    if os.getpid() not in _folders:
        # Windows removes no file that is open or mapped, and at the end of a program some still are.
        _folders[os.getpid()] = tempfile.TemporaryDirectory(prefix="tbmslam-", ignore_cleanup_errors=True)
    return Path(tempfile.mkdtemp(dir=_folders[os.getpid()].name))


def no_room(path: Path, what: str, folder: Path, why: str) -> DatasetError:
    """Return the error of a file that cannot be unpacked or copied into a temporary folder."""
    return DatasetError(
        f"{path}: cannot be {what} into {folder} ({why}): make room, or set TMPDIR to a folder with room"
    )


def _unpack(path: Path) -> UnpackedFile:
    folder = temporary_folder()
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
        raise no_room(path, "unpacked", folder.parent, str(error.strerror)) from error
    return UnpackedFile(content, damage)


def _next_piece(packed: BufferedIOBase) -> bytes | str:
    """Return the next bytes, none at the end; or the fault of the compression as text."""
    try:
        return packed.read1(_PIECE)  # unlike `read`, it also returns the last bytes of a file that was cut off
    except EOFError:
        return "the packed file is cut off"
    except (OSError, zlib.error, lzma.LZMAError) as error:
        return f"the packed file is damaged ({error})"
