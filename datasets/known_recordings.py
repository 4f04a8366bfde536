"""Public recordings by name: where they are, what they may be used for, and how they are read."""

import difflib
import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

from datasets.errors import DatasetError


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
        What its authors allow, how they want to be cited, and where they say so.
    options
        What build_maps needs to be told to read it.
    about
        A few words.
    megabytes
        Size, as others report it; None where nobody does.
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
        last = {one.rpartition("/")[2]: one for one in known}
        near = difflib.get_close_matches(name, known, n=1) or [
            last[one] for one in difflib.get_close_matches(name, last, n=1)
        ]
        meant = f"did you mean {near[0]}?" if near else "see --list"
        raise DatasetError(f"there is no known recording {name!r}: {meant}")
    return known[name]
