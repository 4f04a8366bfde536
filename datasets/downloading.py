"""Public recordings by name, and their downloads, which are resumed and checked."""

import difflib
import functools
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from datasets.errors import DatasetError
from tbmslam.io.atomic_file import replacing, write_text
from tbmslam.special_file import sha256_of

if TYPE_CHECKING:
    import requests

Progress = Callable[[int, int | None], None]
"""Called with the number of bytes so far, and the total if known."""

_CHUNK = 1 << 16  # most bytes that a broken connection loses
_TIMEOUT_S = (20.0, 60.0)  # to connect, and to wait for the next byte
_ATTEMPTS = 3
_LARGEST = 100 << 30  # largest accepted file of unstated size; the largest known file has 24 GB [bytes]


class DownloadError(DatasetError):
    """A file could not be downloaded, or is not the expected file."""


def download(address: str, target: Path, sha256: str | None = None, progress: Progress | None = None) -> bool:
    """Download a file, resuming an earlier attempt, and write its SHA-256 to TARGET.sha256.

    Returns whether anything was downloaded; a correct file is kept. Until the data are complete and checked, they are
    in TARGET.part. Without an expected `sha256` any data are accepted. Raises a `DownloadError` if the server refuses,
    the connection breaks repeatedly, or the digest differs.
    """
    import requests  # noqa: PLC0415 - a wrong name is reported before it is loaded

    if target.is_file():
        _check_existing(target, sha256)
        return False
    part = target.with_name(target.name + ".part")
    for attempt in range(_ATTEMPTS):
        try:
            _fetch(address, part, progress or (lambda _have, _all: None))
            break
        except (
            requests.exceptions.ChunkedEncodingError,
            requests.exceptions.ConnectionError,
            requests.exceptions.Timeout,
        ) as error:
            if attempt + 1 < _ATTEMPTS:
                continue
            have = part.stat().st_size if part.is_file() else 0
            raise DownloadError(
                f"{address}: the connection failed after {have} bytes ({type(error).__name__}): check the network "
                f"and run again to resume"
            ) from None
        except requests.RequestException as error:
            raise DownloadError(f"{address}: cannot be requested ({error}): check the address") from None
    if mismatch := _mismatch(part, target.name):
        part.unlink()
        _tag_file(part).unlink(missing_ok=True)
        raise DownloadError(
            f"{address}: the received file {mismatch}: it was removed: check if the file has moved or needs a password"
        )
    arrived = sha256_of(part)
    if sha256 is not None and arrived != sha256:
        part.unlink()
        raise DownloadError(
            f"{address}: the received file has the SHA-256 {arrived}, not {sha256}: it was removed, run again"
        )
    with replacing(target) as whole:
        part.replace(whole)
    _tag_file(part).unlink(missing_ok=True)
    write_text(_digest_file(target), f"{arrived}  {target.name}\n")
    return True


def _fetch(address: str, part: Path, progress: Progress) -> None:
    """Download the missing part of a file, or all of it if the server cannot resume."""
    import requests  # noqa: PLC0415

    have = part.stat().st_size if part.is_file() else 0
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if _tag_file(part).is_file():
            headers["If-Range"] = _tag_file(part).read_text(encoding="latin-1")
    with requests.get(address, headers=headers, stream=True, timeout=_TIMEOUT_S) as response:
        content_range = response.headers.get("Content-Range", "")
        if response.status_code == requests.codes.requested_range_not_satisfiable and have:
            if content_range == f"bytes */{have}":
                return  # the file is complete
            part.unlink()
            raise DownloadError(
                f"{address}: the earlier part does not belong to this file (416): it was removed, run again"
            )
        if not response.ok:
            raise DownloadError(
                f"{address}: the server says {response.status_code} {response.reason}: check if it has moved"
            )
        resumed = response.status_code == requests.codes.partial_content and content_range.startswith(f"bytes {have}-")
        if have and not resumed:
            part.unlink()  # before its tag is replaced
        tag = response.headers.get("ETag") or response.headers.get("Last-Modified")
        if tag and not tag.startswith("W/"):  # a weak tag does not promise the same bytes
            write_text(_tag_file(part), tag)
        part.parent.mkdir(parents=True, exist_ok=True)
        have = have if resumed else 0
        length = _length(address, response)
        whole = None if length is None else have + length
        most = _LARGEST if whole is None else whole
        with part.open("ab" if resumed else "wb") as stream:
            for chunk in response.iter_content(_CHUNK):
                have += len(chunk)
                if have > most:
                    break
                _append(chunk, stream)
                progress(have, whole)
    if have > most:
        part.unlink()
        raise DownloadError(
            f"{address}: more than {most} bytes arrived, more than announced: the file was removed; ask its publisher"
        )


def _length(address: str, response: "requests.Response") -> int | None:
    """Return the number of bytes that follow; None if it is not stated."""
    if encoding := response.headers.get("Content-Encoding", "").replace("identity", ""):
        raise DownloadError(f"{address}: comes packed as {encoding}, which was not requested: try another address")
    lengths = {part.strip() for part in response.headers.get("Content-Length", "").split(",")} - {""}
    if not lengths:
        return None
    stated = lengths.pop()
    if lengths or not (stated.isascii() and stated.isdigit()):
        raise DownloadError(f"{address}: the server states an unreadable length ({stated}): try again later")
    return int(stated)


_FILE_STARTS = {
    ".bag": (b"#ROSBAG ",),
    ".mcap": (b"\x89MCAP",),
    ".db3": (b"SQLite format 3",),
    ".gz": (b"\x1f\x8b",),
    ".bz2": (b"BZh",),
    ".zip": (b"PK",),
    ".png": (b"\x89PNG",),
    ".pdf": (b"%PDF",),
}
"""First bytes of files by their suffix. Others are text."""
_WEB_PAGE_STARTS = (b"<!doctype", b"<html", b"<?xml", b"<head")
"""First bytes of a web page, such as a login page."""


def _mismatch(part: Path, name: str) -> str | None:
    """Return why the data cannot be a file of that name; None if they may be."""
    with part.open("rb") as stream:
        head = stream.read(512)
    if not head:
        return "is empty"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(_WEB_PAGE_STARTS):
        return "is a web page"
    starts = _FILE_STARTS.get(Path(name).suffix.lower(), ())
    if starts and not head.startswith(starts):
        return f"does not begin as a {Path(name).suffix} file"
    return None


def _append(chunk: bytes, stream: BinaryIO) -> None:
    try:
        stream.write(chunk)
        stream.flush()  # so that a full disk raises its error here, and not when the file is closed
    except OSError as error:
        raise DownloadError(
            f"{stream.name}: cannot be written ({error.strerror}): make room or choose another place and run again"
        ) from error


def _check_existing(target: Path, sha256: str | None) -> None:
    note = _digest_file(target)
    expected = sha256 or (note.read_text(encoding="utf-8").partition(" ")[0] if note.is_file() else None)
    if expected is None:
        if mismatch := _mismatch(target, target.name):
            raise DownloadError(f"{target}: {mismatch}: remove it to download it again")
        write_text(note, f"{sha256_of(target)}  {target.name}\n")
    elif sha256_of(target) != expected:
        raise DownloadError(f"{target}: is not the file that was downloaded: remove it to download it again")


def _digest_file(target: Path) -> Path:
    return target.with_name(target.name + ".sha256")


def _tag_file(part: Path) -> Path:
    return part.with_name(part.name + ".tag")


@dataclass(frozen=True)
class KnownRecording:
    """A public recording."""

    name: str
    """Name, such as `stata/2011-01-24-06-18-27`."""
    addresses: tuple[str, ...]
    """Addresses of its files, the recording first."""
    license: str
    citation: str
    page: str
    """Licence, citation, and the page that states them."""
    options: str
    """Options that build_maps needs to read it."""
    about: str
    truth: str = ""
    """Address of its ground truth, if that is not among its files."""
    megabytes: float | None = None
    """Reported size [MB]; None if unknown."""
    sha256: Mapping[str, str] = field(default_factory=dict)
    """Digests by file name, where they are known."""
    reached: bool = False
    """Whether an address was reached when this list was made."""


@functools.cache
def known_recordings() -> Mapping[str, KnownRecording]:
    """Return all known recordings by name."""
    listed = tomllib.loads((files(__package__) / "known_recordings.toml").read_text(encoding="utf-8"))
    found: dict[str, KnownRecording] = {}
    for collection, common in listed.items():
        for key, recording in common["recordings"].items():
            name = f"{collection}/{key}"
            addresses = tuple(common["address"] + file for file in recording.pop("files"))
            facts = {key: common[key] for key in common.keys() - {"address", "recordings"}} | recording
            found[name] = KnownRecording(name, addresses, **facts)
    return found


def known_recording(name: str) -> KnownRecording:
    """Return a recording by name; raise a `DatasetError` with the nearest name if there is none."""
    known = known_recordings()
    if name not in known:
        short_names = {full.rpartition("/")[2]: full for full in known}
        near = difflib.get_close_matches(name, known, n=1) or [
            short_names[full] for full in difflib.get_close_matches(name, short_names, n=1)
        ]
        hint = f"did you mean {near[0]}?" if near else "see --list"
        raise DatasetError(f"there is no known recording {name!r}: {hint}")
    return known[name]
