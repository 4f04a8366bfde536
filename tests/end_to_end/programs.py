"""The programs, called as a shell calls them but within this process, and what they leave behind."""

import json
from pathlib import Path
from typing import Any

from tools import build_maps, make_world, merge


def simulate(out: Path, *arguments: object) -> Path:
    """Write bags of a simulated building and return their folder."""
    assert make_world.main([*map(str, arguments), "-o", str(out)]) == 0
    return out


def build(out: Path, *arguments: object) -> Path:
    """Map recordings and return the folder of the robots' folders."""
    assert build_maps.main([*map(str, arguments), "-o", str(out)]) == 0
    return out


def merge_maps(out: Path, *arguments: object, status: int = 0) -> dict[str, Any]:
    """Merge maps and return the report."""
    assert merge.main([*map(str, arguments), "-o", str(out)]) == status
    return report(out)


def report(folder: Path) -> dict[str, Any]:
    """Return what a merge reported."""
    content: dict[str, Any] = json.loads((folder / "report.json").read_text())
    return content


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder, but for the pages that tell how long it took."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "report.html")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
