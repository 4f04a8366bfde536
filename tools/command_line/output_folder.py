"""A folder for the results of one run at a time."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, SoftFileLock, Timeout

from tbmslam.errors import TbmSlamError

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
