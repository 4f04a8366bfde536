"""On what a figure was measured."""

import importlib.metadata
import os
import platform
from collections.abc import Mapping
from pathlib import Path

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
