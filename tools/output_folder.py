"""A folder to write results into, by one run at a time."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from tbmslam.errors import TbmSlamError

_LOCK = ".tbmslam.lock"


class OutputError(TbmSlamError):
    """The folder to write into cannot be used."""


@contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Keep a folder, made if need be, for oneself while a block runs; what was made in vain is removed.

    Raises
    ------
    OutputError
        The folder cannot be written into, or another run is writing there.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
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
        # While it is held, so that nobody else's is removed; whoever waits for nothing finds it or makes a new one.
        with suppress(OSError):
            (folder / _LOCK).unlink()
        lock.release()
        _remove_empty(made)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, the innermost first, as far as they are empty."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
