"""Tables for a terminal that are Markdown too, and the machine that filled them."""

import importlib.metadata
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path


def text_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; all columns but the first two are right-aligned.

    Parameters
    ----------
    head
        Names of the columns.
    rows
        Cells, as many a row as there are names.
    """
    columns = list(zip(head, *rows, strict=True))
    widths = [max(3, *(len(cell) for cell in column)) for column in columns]
    rule = [("-" * width if index < 2 else "-" * (width - 1) + ":") for index, width in enumerate(widths)]
    lines = [_line(head, widths), "| " + " | ".join(rule) + " |"]
    lines += [_line(row, widths) for row in rows]
    return "\n".join(lines)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    aligned = [
        cell.ljust(width) if index < 2 else cell.rjust(width)
        for index, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]
    return "| " + " | ".join(aligned) + " |"


def number(value: float | None, digits: int) -> str:
    """Return a number with the given number of decimals, or a dash for None."""
    return "-" if value is None else f"{value:.{digits}f}"


LIBRARIES = ("tbmslam", "numpy", "numba", "scipy", "opencv-python-headless", "rosbags")


def describe_machine() -> dict[str, object]:
    """Return processor, system and versions; `load` is the mean number of busy processes in the last minute."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in LIBRARIES},
    }


def machine_line(machine: Mapping[str, object]) -> str:
    """Return a description as a line for people."""
    return ", ".join(f"{key} {value}" for key, value in machine.items())


def _processor() -> str:
    """Return the processor's name: where there is /proc, platform does not know it."""
    listing = Path("/proc/cpuinfo")
    if listing.exists():
        for line in listing.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"
