"""Folders on disk for compiled kernels: one for each file of kernels and each state of what it is compiled from.

Numba's own cache looks at one file at a time, so it runs stale code when a callee in another file changed, and it
ignores ``NUMBA_BOUNDSCHECK`` once something is cached. A folder is therefore named by the text of a file, of the files
of this package that it imports, directly or not, by numba's version, and by that flag: a change in one file leaves what
others compiled, and installations of the same text share it (see `cache_locator`).
"""

import hashlib
import os
import re
import shutil
import tempfile
import time
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rb"^from tbmslam((?:\.\w+)+) import ", re.MULTILINE)
_FOLDER = re.compile(r"(?:(\w+)-)?[0-9a-f]{16}")
"""What this file names, and what versions before it named: one folder for all files."""
_DAY = 86400.0
_KEPT_DAYS = 30.0
"""Two branches that one works on in turn stay compiled."""
_KEPT_STATES = 20
"""Of one file; a day's work on it leaves about as many."""


def cache_root() -> Path | None:
    """Return the folder of all caches, made where it is missing; None where there is no place for it."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    try:
        root = root.expanduser() / "tbmslam"
        root.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: a user without a home, as in some containers
        return None
    return root


@cache
def folder_of(source: str) -> Path | None:
    """Return where the kernels of a file are cached, asked once in each process; None where there is no place."""
    root = _root()
    return None if root is None else cache_folder(Path(source), root)


@cache
def _root() -> Path | None:
    return cache_root()


def cache_folder(source: Path, root: Path) -> Path | None:
    """Return the folder for what is compiled from a file, marked as used; None where no one can write there."""
    try:
        folder = root / f"{source.stem}-{_digest(source)}"
        if not folder.exists():
            folder.mkdir(exist_ok=True)  # another process may be faster
            _prune(root, time.time())
        elif time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)
        with tempfile.TemporaryFile(dir=folder):  # else numba would cache where it does not see changes of callees
            return folder
    except OSError:  # a read-only place, or a package in an archive
        return None


def imported_files(text: bytes) -> set[Path]:
    """Return the files of this package that a file's text imports."""
    places = {_PACKAGE.joinpath(*name.decode().split(".")) for name in _IMPORT.findall(text)}
    return {place / "__init__.py" if place.is_dir() else place.with_suffix(".py") for place in places}


@cache
def _text(source: Path) -> bytes:
    return source.read_bytes()


def _digest(source: Path) -> str:
    """Return what the text of a file and of all that is compiled into it comes down to."""
    found, unread = {source}, [source]
    while unread:
        new = imported_files(_text(unread.pop())) - found
        found |= new
        unread += new
    compiler = f"{version('numba')} {os.environ.get('NUMBA_BOUNDSCHECK', '')}"
    digest = hashlib.sha256(compiler.encode())
    for file in sorted(found):
        digest.update(f"\0{file.name}\0{len(_text(file))}\0".encode())
        digest.update(_text(file))
    return digest.hexdigest()[:16]


def _prune(root: Path, now: float) -> None:
    """Remove the folders that were not used for long, and of each file those beyond the latest."""
    kept: dict[str, int] = {}
    used = {}
    for folder in root.iterdir():
        if _FOLDER.fullmatch(folder.name):
            with suppress(FileNotFoundError):  # another process prunes, too
                used[folder] = folder.stat().st_mtime
    for folder in sorted(used, key=lambda each: -used[each]):
        stem = folder.name.rpartition("-")[0]
        kept[stem] = kept.get(stem, 0) + 1
        if kept[stem] > _KEPT_STATES or now - used[folder] > _KEPT_DAYS * _DAY:
            shutil.rmtree(folder, ignore_errors=True)
