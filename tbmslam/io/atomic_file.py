"""Atomic writing: a file appears complete or not at all."""

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from tbmslam.errors import TbmSlamError
from tbmslam.special_file import is_device_or_pipe


class FileNotWrittenError(TbmSlamError):
    """A file could not be written; an earlier file of that name is unchanged."""


@contextmanager
def replacing(path: str | os.PathLike[str], make_way: Callable[[], object] | None = None) -> Iterator[Path]:
    """Yield a temporary path beside `path`, and rename it to `path` if the block succeeds.

    The new file is on the disk before the renaming, and the name before the return, so a crash or a power cut leaves
    the old file or the new one. Missing parent folders are made. A file has one writer at a time. `make_way` is called
    just before the renaming, to remove files that would not match. Raises a `FileNotWrittenError`, and removes the
    temporary file, if the file cannot be written, or if the path is not a file but a device, for example.
    """
    target = Path(path)
    if not target.name:
        raise FileNotWrittenError(f"{str(path)!r} is no file name: give a file name")
    _check_place(target)
    # The suffix stays last, since some writers choose their format by it.
    temporary = target.with_name(f".{secrets.token_hex(4)}.{target.name}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        flush_file(temporary)
        if make_way is not None:
            make_way()
        temporary.replace(target)
        with suppress(OSError):  # the file is replaced already
            _flush_folder(target.parent)
        with suppress(OSError):
            _remove_leftovers(target)
    except OSError as error:
        raise FileNotWrittenError(
            f"{target}: cannot be written ({error.strerror or error}): choose another place or make room"
        ) from error
    finally:
        with suppress(OSError):  # there is no file or no folder
            temporary.unlink()


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file atomically; see `replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file atomically as UTF-8 without changes of line ends; see `replacing`.

    Names of files that are no text appear with their bytes written out.
    """
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def _check_place(target: Path) -> None:
    """Refuse to replace a device, a pipe or a link to one; folders are never replaced."""
    try:
        is_taken = is_device_or_pipe(target)
    except OSError:  # a folder of the path may not be readable; writing reports it
        return
    # /dev/stdout may be a link to a file, but must not be replaced.
    if is_taken or target.absolute().parent == Path(os.devnull).parent:
        raise FileNotWrittenError(f"{target}: is a device or a pipe: give the name of a file")


def _remove_leftovers(target: Path) -> None:
    """Remove temporary files of writers that were killed."""
    for old in target.parent.glob(f".{'[0-9a-f]' * 8}.{escape(target.name)}"):
        old.unlink(missing_ok=True)


def flush_file(path: Path) -> None:
    """Write a file's content to the disk."""
    with path.open("r+b") as stream:
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    """Write a folder's names to the disk, if the system can open folders."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
