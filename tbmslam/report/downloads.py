"""The files beside a report that readers of it want."""

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

_WANTED = (
    "map.yaml",
    "map.pgm",
    "map.npz",
    "map.tif",
    "map.bag",
    "map.mcap",
    "trajectory*.tum",
    "pignistic.png",
    "run.json",
    "report.json",
    "config.toml",
)
"""Names, or patterns of them, in the order in which they are offered."""


def downloads(page: Path, folder: Path) -> Sequence[str]:
    """Return the addresses of a map's files as seen from a page.

    Parameters
    ----------
    page
        Folder of the page.
    folder
        Folder of the map, which is the same or within it.
    """
    found = [path for pattern in _WANTED for path in sorted(folder.glob(pattern)) if path.is_file()]
    return [quote(bytes(path.relative_to(page))) for path in found]
