"""How much memory there is for grids."""

import os
import sys
from functools import cache
from pathlib import Path

_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@cache
def machine_memory() -> int:
    """Return the memory of the machine, or of the container where that has less [B]; where nobody knows, no limit."""
    return min(_physical(), _own_limit(), *(_limit(Path(file)) for file in _CONTAINER_LIMITS))


def _own_limit() -> int:
    """Return how much address space this program may take."""
    try:
        import resource  # noqa: PLC0415 - not every system has it
    except ImportError:
        return sys.maxsize
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return sys.maxsize if limit == resource.RLIM_INFINITY else limit


def _physical() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not on Windows, nor everywhere else
        return sys.maxsize


def _limit(file: Path) -> int:
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):  # there is none, or it says "max"
        return sys.maxsize
