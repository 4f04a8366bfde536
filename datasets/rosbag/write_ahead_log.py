"""Databases whose recorder did not close them: their last messages are in a write-ahead log, `run_0.db3-wal`."""

import os
import shutil
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple

from datasets.errors import DatasetError
from datasets.rosbag.bag_files import log_of, no_room, temporary_folder

_known: dict[tuple[tuple[str, int, int], ...], "WholeDatabase"] = {}


class WholeDatabase(NamedTuple):
    """A file as it can be read."""

    path: Path
    """The file itself if it has no log, else a temporary copy that holds the messages of the log too."""
    note: str | None = None
    """What was done, or why the log could not be used."""


def with_log(path: Path) -> WholeDatabase:
    """Return a file that holds all messages of a database and its log, neither of which is changed."""
    log = log_of(path)
    if log is None:
        return WholeDatabase(path)
    key = tuple((os.path.realpath(file), file.stat().st_size, file.stat().st_mtime_ns) for file in (path, log))
    if key not in _known or not _known[key].path.exists():
        _known[key] = _replayed(path, log)
    return _known[key]


def _replayed(path: Path, log: Path) -> WholeDatabase:
    folder = temporary_folder()
    copy = folder / path.name
    try:
        shutil.copyfile(path, copy)
        shutil.copyfile(log, f"{copy}-wal")
        with closing(sqlite3.connect(copy)) as database:
            ((_, pages, _),) = database.execute("PRAGMA wal_checkpoint(FULL)").fetchall()
            if pages <= 0:  # sqlite ignores what is no log
                raise sqlite3.DatabaseError("no whole page")
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
            database.execute("SELECT count(*) FROM messages, topics WHERE messages.id < 0").fetchall()
    except PermissionError as error:
        _remove(folder)
        raise DatasetError(f"{log}: cannot be read: {error.strerror}: check its permissions") from error
    except OSError as error:
        _remove(folder)
        raise no_room(path, "copied", folder.parent, str(error.strerror)) from error
    except sqlite3.Error as error:
        _remove(folder)
        if "full" in str(error):
            raise no_room(path, "copied", folder.parent, str(error)) from error
        return WholeDatabase(path, f"its recorder did not close it, and {log.name} does not fit it ({error})")
    return WholeDatabase(copy, f"its recorder did not close it, and the rest was read from {log.name}")


def _remove(folder: Path) -> None:
    with suppress(OSError):
        shutil.rmtree(folder)
