"""The memory of the machine, and the part of it that this program may use."""

import os
import sys
from functools import cache
from pathlib import Path

_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@cache
def machine_memory() -> int:
    """Return the memory of the machine, or of the container if that has less [B]; no limit if unknown."""
    return min(_physical(), address_space(), *(_limit(Path(file)) for file in _CONTAINER_LIMITS))


def address_space() -> int:
    """Return the largest address space of this program [B]; `sys.maxsize` without a limit, or if it is unknown."""
    try:
        import resource  # noqa: PLC0415 - not every system has it
    except ImportError:
        return sys.maxsize
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return sys.maxsize if limit == resource.RLIM_INFINITY else limit


def _physical() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not available on all systems
        return sys.maxsize


def _limit(file: Path) -> int:
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):  # there is none, or it holds "max"
        return sys.maxsize
