"""Cache folders for compiled kernels: one for each version of each file of kernels.

Numba's own cache checks single files. It runs stale code after a change of a callee in another file, and it ignores
``NUMBA_BOUNDSCHECK`` for cached code. The name of a folder is therefore a digest of the file, of all files of this
package that it imports, of numba's version and of that flag. Installations with the same text share the folder (see
`cache_locator`).
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
_COMPILER = _PACKAGE / "kernels" / "kernel_compiler.py"
"""Compiles all kernels. No import statement names it, since newer versions of numba are used without it."""
_IMPORT = re.compile(rb"^from tbmslam((?:\.\w+)+) import ", re.MULTILINE)
_FOLDER = re.compile(r"(?:(\w+)-)?[0-9a-f]{16}")
"""Names of cache folders; earlier versions used one folder without a stem for all files."""
_DAY = 86400.0
_KEPT_DAYS = 30.0
"""Unused folders are kept so long, so that alternating between two branches does not compile again."""
_KEPT_STATES = 20
"""Largest number of folders of one file; a day's work on it leaves about as many."""


def cache_root() -> Path | None:
    """Return the folder of all caches, and make it if it is missing; None if that is not possible."""
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
    """Return the cache folder of a file, determined once in each process; None if none is possible."""
    root = _root()
    return None if root is None else cache_folder(Path(source), root)


@cache
def _root() -> Path | None:
    return cache_root()


def cache_folder(source: Path, root: Path) -> Path | None:
    """Return the cache folder of a file, and mark it as used; None if it is not writable."""
    try:
        folder = root / f"{source.stem}-{_digest(source)}"
        if not folder.exists():
            folder.mkdir(exist_ok=True)  # another process may have made it
            _prune(root, time.time())
        elif time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)
        with tempfile.TemporaryFile(dir=folder):  # in an unwritable folder numba would fall back to its own cache
            return folder
    except OSError:  # a read-only folder, or a package in an archive
        return None


def imported_files(text: bytes) -> set[Path]:
    """Return the files of this package that a file's text imports."""
    places = {_PACKAGE.joinpath(*name.decode().split(".")) for name in _IMPORT.findall(text)}
    return {place / "__init__.py" if place.is_dir() else place.with_suffix(".py") for place in places}


@cache
def _text(source: Path) -> bytes:
    return source.read_bytes()


def _digest(source: Path) -> str:
    """Return the digest of a file and of all files that are compiled into it."""
    found, unread = {source, _COMPILER}, [source, _COMPILER]
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
    """Remove folders that were unused for long, and the oldest folders of files with too many."""
    kept: dict[str, int] = {}
    used = {}
    for folder in root.iterdir():
        if _FOLDER.fullmatch(folder.name):
            with suppress(FileNotFoundError):  # another process may remove folders, too
                used[folder] = folder.stat().st_mtime
    for folder in sorted(used, key=lambda each: -used[each]):
        stem = folder.name.rpartition("-")[0]
        kept[stem] = kept.get(stem, 0) + 1
        if kept[stem] > _KEPT_STATES or now - used[folder] > _KEPT_DAYS * _DAY:
            shutil.rmtree(folder, ignore_errors=True)
