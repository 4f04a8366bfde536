"""A folder for the results of one run at a time."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, SoftFileLock, Timeout

from tbmslam.errors import TbmSlamError
from tbmslam.io.atomic_file import write_text
from tbmslam.io.map_folder import map_files
from tbmslam.special_file import sha256_of, why_unreadable
from tools.command_line.paths import EXTRA_FILES

_LOCK = ".tbmslam.lock"
_TRIES = 100


class OutputError(TbmSlamError):
    """The output folder cannot be used."""


@contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Create and lock a folder for a block; new folders that stay empty are removed."""
    made: list[Path] = []
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        _take(lock, folder, made)
    except Timeout:
        raise OutputError(
            f"{folder}: another run is writing there: wait for it, or choose another folder with -o"
        ) from None
    except OSError as error:
        _remove_empty(made)
        raise OutputError(
            f"{folder}: cannot be written into ({error.strerror or error}): choose another folder with -o"
        ) from None
    try:
        yield
    finally:
        # The file is removed before the release, so that the lock of another run is never removed: another run that has
        # already opened the file notices that it was removed. On a disk without locks, the release removes the file.
        if not isinstance(lock, SoftFileLock):
            with suppress(OSError):
                (folder / _LOCK).unlink()
        lock.release()
        _remove_empty(made)


def _take(lock: FileLock, folder: Path, made: list[Path]) -> None:
    """Create and lock a folder, and list the new folders; another run may remove an empty folder meanwhile."""
    for attempt in range(_TRIES):
        made[:] = [path for path in (folder, *folder.parents) if not path.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except (FileNotFoundError, FileExistsError):  # another run may remove the folder at this moment
            if attempt == _TRIES - 1:
                raise
        else:
            return


def _remove_empty(folders: list[Path]) -> None:
    """Remove empty folders, the innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


NAME = "SHA256SUMS"
_BESIDE_THE_MAP = (*("config.toml", "run.json", "report.json", "overlay.png", "contradictions.png"), *EXTRA_FILES)
"""Files of a result besides the map, without the pages, which contain times."""


def write_checksums(folder: Path) -> None:
    """Write the digests of all files of a result, which must exist."""
    files = [*map_files(folder), *(folder / name for name in _BESIDE_THE_MAP if (folder / name).is_file())]
    lines = [f"{_digest(file)}  {file.name}\n" for file in sorted(files)]
    write_text(folder / NAME, "".join(lines))


def changed_files(folder: Path) -> list[str] | None:
    """Return the names of missing or changed files; None without a list of digests."""
    try:
        if why_unreadable(folder / NAME):
            return None
        lines = (folder / NAME).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    noted = [line.partition("  ") for line in lines]
    return [name for digest, _, name in noted if digest != _digest(folder / Path(name).name)]


def _digest(file: Path) -> str | None:
    try:
        return sha256_of(file) if file.is_file() else None
    except OSError:
        return None
