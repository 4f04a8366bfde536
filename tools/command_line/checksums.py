"""SHA256SUMS beside a result: whether its files are as they were written; `sha256sum --check` reads it, too."""

import hashlib
from pathlib import Path

from tbmslam.io.atomic_file import write_text
from tbmslam.io.map_folder import map_files
from tbmslam.io.special_file import why_unreadable

NAME = "SHA256SUMS"
_BESIDE_THE_MAP = (
    *("config.toml", "run.json", "report.json", "overlay.png", "contradictions.png"),
    *("map.tif", "map.bag", "map.mcap"),
)
"""What programs write besides the map, but for the pages, which tell times."""


def write_checksums(folder: Path) -> None:
    """Write the digest of every file of a result, which must all be there.

    Raises
    ------
    FileNotWrittenError
        If the file cannot be written.
    """
    files = [*map_files(folder), *(folder / name for name in _BESIDE_THE_MAP if (folder / name).is_file())]
    lines = [f"{_digest(file)}  {file.name}\n" for file in sorted(files)]
    write_text(folder / NAME, "".join(lines))


def changed_files(folder: Path) -> list[str] | None:
    """Return the names of files that are gone or not as they were written; None where nobody noted how they were."""
    try:
        if why_unreadable(folder / NAME):
            return None
        lines = (folder / NAME).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return None
    noted = [line.partition("  ") for line in lines]
    return [name for digest, _, name in noted if digest != _digest(folder / Path(name).name)]


def _digest(file: Path) -> str | None:
    try:
        if not file.is_file():
            return None
        if not file.stat().st_size:  # what passes for empty may have no end
            return hashlib.sha256().hexdigest()
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return None
