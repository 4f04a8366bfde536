"""Names of robots, after the files of their recordings."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

_ENDINGS = re.compile(r"\.(gz|bz2|xz|zst|zstd|bag|mcap|db3|log|clf|active)$", re.IGNORECASE)
_UNSAFE = re.compile(r"[^\w-]+")
_LONGEST = 60
"""Characters of a name: file systems allow 255 bytes, and a table should show it."""
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)
"""Names that Windows keeps for devices. (A name that begins with `-` would be taken for an option.)"""


def robot_names(recordings: Sequence[Path]) -> list[str]:
    """Name one robot for each recording: `week/monday.bag` is monday.

    Recordings of equal names get the name of their folder in front, as in `north_monday`; what is still equal gets a
    number. Names are equal if they differ in case only, since some file systems do not tell that. Characters that are
    not safe in a path are replaced.

    Parameters
    ----------
    recordings
        Their files or folders.

    Returns
    -------
    Different names, in the same order.
    """
    plain = [safe_name(_stem(path)) for path in recordings]
    names = _with_folders(recordings, plain)
    taken: set[str] = set()
    for index, name in enumerate(names):
        number = 2
        while names[index].casefold() in taken:
            names[index] = f"{name}-{number}"
            number += 1
        taken.add(names[index].casefold())
    return names


def safe_name(text: str) -> str:
    """Return a name that every file system accepts: letters, digits, `_` and `-`."""
    name = _UNSAFE.sub("_", text)[:_LONGEST].strip("_") or "robot"
    return f"robot_{name}" if _RESERVED.fullmatch(name) or name.startswith("-") else name


def _with_folders(recordings: Sequence[Path], names: Sequence[str]) -> list[str]:
    counts = Counter(name.casefold() for name in names)
    return [
        safe_name(f"{path.absolute().parent.name}_{name}") if counts[name.casefold()] > 1 else name
        for path, name in zip(recordings, names, strict=True)
    ]


def _stem(recording: Path) -> str:
    """Return the name of a recording without its endings: `drive.log.gz` is drive."""
    name = recording.absolute().name
    while (shorter := _ENDINGS.sub("", name)) not in ("", name):
        name = shorter
    return name
