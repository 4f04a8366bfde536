"""Public recordings by name, and their download: resumed where it broke off, checked when it arrives."""

import difflib
import functools
import hashlib
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import BinaryIO

import requests

from datasets.errors import DatasetError
from tbmslam.io.atomic_file import replacing, write_text

Progress = Callable[[int, int | None], None]
"""Called with the number of bytes so far, and in all if known."""

_CHUNK = 1 << 16  # bytes that are lost at most when a connection breaks
_TIMEOUT_S = (20.0, 60.0)  # to connect, and between two bytes
_ATTEMPTS = 3
_LARGEST = 100 << 30  # of a file without a stated size; the largest known has 24 GB [bytes]
_BROKEN = (requests.exceptions.ChunkedEncodingError, requests.exceptions.ConnectionError, requests.exceptions.Timeout)


class DownloadError(DatasetError):
    """A file did not arrive, or not as it should be."""


def download(address: str, target: Path, sha256: str | None = None, progress: Progress | None = None) -> bool:
    """Fetch a file, going on where an earlier attempt broke off, and note its SHA-256 in TARGET.sha256.

    Parameters
    ----------
    address
        http or https.
    target
        Where it goes; until it is whole and right, what has arrived is in TARGET.part.
    sha256
        What it must be; None if unknown, then what arrives first is believed.
    progress
        Receives the progress.

    Returns
    -------
    Whether anything was fetched; a file that is there and right stays.

    Raises
    ------
    DownloadError
        The server refuses, the connection breaks again and again, or the file is not what it should be.
    """
    if target.is_file():
        _check_kept(target, sha256)
        return False
    part = target.with_name(target.name + ".part")
    target.parent.mkdir(parents=True, exist_ok=True)
    for attempt in range(_ATTEMPTS):
        try:
            _fetch(address, part, progress or (lambda _have, _all: None))
            break
        except _BROKEN as error:
            if attempt + 1 < _ATTEMPTS:
                continue
            have = part.stat().st_size if part.is_file() else 0
            raise DownloadError(
                f"{address}: the connection failed after {have} bytes ({type(error).__name__}): check the network "
                f"and run again to resume"
            ) from None
        except requests.RequestException as error:
            raise DownloadError(f"{address}: cannot be requested ({error}): check the address") from None
    if why := _doubt(part, target.name):
        part.unlink()
        _tag_of(part).unlink(missing_ok=True)
        raise DownloadError(
            f"{address}: what arrived {why}: it was removed: check if the file has moved or needs a password"
        )
    arrived = _digest(part)
    if sha256 is not None and arrived != sha256:
        part.unlink()
        raise DownloadError(f"{address}: arrived with SHA-256 {arrived} and not {sha256}: removed, run again")
    with replacing(target) as whole:
        part.replace(whole)
    _tag_of(part).unlink(missing_ok=True)
    write_text(_note_of(target), f"{arrived}  {target.name}\n")
    return True


def _fetch(address: str, part: Path, progress: Progress) -> None:
    """Fetch the missing part of a file, or all of it if the server cannot resume."""
    have = part.stat().st_size if part.is_file() else 0
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if _tag_of(part).is_file():
            headers["If-Range"] = _tag_of(part).read_text(encoding="latin-1")
    with requests.get(address, headers=headers, stream=True, timeout=_TIMEOUT_S) as answer:
        said = answer.headers.get("Content-Range", "")
        if answer.status_code == requests.codes.requested_range_not_satisfiable and have and said == f"bytes */{have}":
            return  # it broke off after the last byte
        if answer.status_code == requests.codes.requested_range_not_satisfiable and have:
            part.unlink()
            raise DownloadError(
                f"{address}: the earlier part does not belong to this file (416): it was removed, run again"
            )
        if not answer.ok:
            raise DownloadError(
                f"{address}: the server says {answer.status_code} {answer.reason}: check if it has moved"
            )
        goes_on = answer.status_code == requests.codes.partial_content and said.startswith(f"bytes {have}-")
        tag = answer.headers.get("ETag") or answer.headers.get("Last-Modified")
        if tag and not tag.startswith("W/"):  # a weak tag does not promise the same bytes
            write_text(_tag_of(part), tag)
        have = have if goes_on else 0
        length = _length(address, answer)
        whole = None if length is None else have + length
        most = _LARGEST if whole is None else whole
        with part.open("ab" if goes_on else "wb") as stream:
            for chunk in answer.iter_content(_CHUNK):
                have += len(chunk)
                if have > most:
                    break
                _add(chunk, stream)
                progress(have, whole)
    if have > most:
        part.unlink()
        raise DownloadError(
            f"{address}: more than {most} bytes arrived, more than announced: the file was removed; ask its publisher"
        )


def _length(address: str, answer: requests.Response) -> int | None:
    """Return the number of bytes to come; None if it is not stated."""
    if encoding := answer.headers.get("Content-Encoding", "").replace("identity", ""):
        raise DownloadError(f"{address}: comes packed as {encoding}, which was not requested: try another address")
    lengths = {part.strip() for part in answer.headers.get("Content-Length", "").split(",")} - {""}
    if not lengths:
        return None
    stated = lengths.pop()
    if lengths or not (stated.isascii() and stated.isdigit()):
        raise DownloadError(f"{address}: the server states an unreadable length ({stated}): try again later")
    return int(stated)


_BEGINNINGS = {
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
_PAGES = (b"<!doctype", b"<html", b"<?xml", b"<head")
"""First bytes of a web page, such as a login page."""


def _doubt(part: Path, name: str) -> str | None:
    """Return why the received data cannot be the file of that name; None if they may be."""
    with part.open("rb") as stream:
        head = stream.read(512)
    if not head:
        return "is empty"
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(_PAGES):
        return "is a web page"
    beginnings = _BEGINNINGS.get(Path(name).suffix.lower(), ())
    if beginnings and not head.startswith(beginnings):
        return f"does not begin as a {Path(name).suffix} file"
    return None


def _add(chunk: bytes, stream: BinaryIO) -> None:
    try:
        stream.write(chunk)
        stream.flush()  # a full disk gives its error here, and not when the file is closed
    except OSError as error:
        raise DownloadError(
            f"{stream.name}: cannot be written ({error.strerror}): make room or choose another place and run again"
        ) from error


def _check_kept(target: Path, sha256: str | None) -> None:
    """Check an existing file."""
    note = _note_of(target)
    expected = sha256 or (note.read_text(encoding="utf-8").partition(" ")[0] if note.is_file() else None)
    if expected is None:
        if why := _doubt(target, target.name):
            raise DownloadError(f"{target}: {why}: remove it to download it again")
        write_text(note, f"{_digest(target)}  {target.name}\n")
    elif _digest(target) != expected:
        raise DownloadError(f"{target}: is not the file that was downloaded: remove it to download it again")


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _note_of(target: Path) -> Path:
    return target.with_name(target.name + ".sha256")


def _tag_of(part: Path) -> Path:
    return part.with_name(part.name + ".tag")


@dataclass(frozen=True)
class KnownRecording:
    """A public recording.

    Parameters
    ----------
    name
        As `stata/2011-01-24-06-18-27`.
    addresses
        Of its files, the recording first.
    license, citation, page
        Licence, citation, and the page that states them.
    options
        Options that build_maps needs to read it.
    truth
        Where its truth is, if that is not among its files.
    about
        A few words.
    megabytes
        Reported size [MB]; None if unknown.
    sha256
        Digests by file name, where they are known.
    reached
        Whether an address was ever reached when this list was made.
    """

    name: str
    addresses: tuple[str, ...]
    license: str
    citation: str
    page: str
    options: str
    truth: str
    about: str
    megabytes: float | None
    sha256: Mapping[str, str]
    reached: bool


@functools.cache
def known_recordings() -> Mapping[str, KnownRecording]:
    """Return all of them by name."""
    listed = tomllib.loads((files(__package__) / "known_recordings.toml").read_text(encoding="utf-8"))
    found: dict[str, KnownRecording] = {}
    for collection, said in listed.items():
        for key, recording in said["recordings"].items():
            name = f"{collection}/{key}"
            found[name] = KnownRecording(
                name=name,
                addresses=tuple(said["address"] + file for file in recording["files"]),
                license=said["license"],
                citation=said["citation"],
                page=said["page"],
                options=said["options"],
                truth=said.get("truth", ""),
                about=recording["about"],
                megabytes=recording.get("megabytes"),
                sha256=recording.get("sha256", {}),
                reached=recording.get("reached", False),
            )
    return found


def known_recording(name: str) -> KnownRecording:
    """Return a recording by name.

    Raises
    ------
    DatasetError
        There is none of that name; the nearest is named.
    """
    known = known_recordings()
    if name not in known:
        last = {full.rpartition("/")[2]: full for full in known}
        near = difflib.get_close_matches(name, known, n=1) or [
            last[full] for full in difflib.get_close_matches(name, last, n=1)
        ]
        meant = f"did you mean {near[0]}?" if near else "see --list"
        raise DatasetError(f"there is no known recording {name!r}: {meant}")
    return known[name]
