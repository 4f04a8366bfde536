"""SHA256SUMS: the digests of the files of a result."""

from pathlib import Path

from tbmslam.io.atomic_file import write_text
from tbmslam.io.map_folder import map_files
from tbmslam.special_file import sha256_of, why_unreadable
from tools.command_line.extra_files import EDIT_FILES, EXTRA_FILES

NAME = "SHA256SUMS"
_RECORDS = ("config.toml", "run.json", "report.json", "overlay.png", "contradictions.png")
RUN_FILES = (*_RECORDS, "report.html")
"""Files about the run that made a map. They contradict another map in its folder."""
_BESIDE_THE_MAP = (*_RECORDS, *EXTRA_FILES, *EDIT_FILES)
"""Files of a result besides the map, without the pages, which contain times."""


def write_checksums(folder: Path) -> None:
    """Write the digests of all files of a result, which must exist."""
    files = [*map_files(folder), *(folder / name for name in _BESIDE_THE_MAP if (folder / name).is_file())]
    lines = [f"{_digest(file)}  {file.name}\n" for file in sorted(files)]
    write_text(folder / NAME, "".join(lines))


def changed_files(folder: Path) -> list[str] | None:
    """Return the names of missing or changed files; None without a list of digests."""
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
        return sha256_of(file) if file.is_file() else None
    except OSError:
        return None
