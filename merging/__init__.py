"""Merges maps with unknown relative poses into one map.

The names below are the interface for notebooks. Each is loaded at its first use.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from merging.alignment import Alignment
    from merging.config import MergeConfig
    from merging.merger import Merge, align, merge

__all__ = ["Alignment", "Merge", "MergeConfig", "align", "merge"]

_HOMES = {"Alignment": "alignment", "Merge": "merger", "MergeConfig": "config", "align": "merger", "merge": "merger"}


def __getattr__(name: str) -> object:
    """Load a name at its first use: a program that needs only the parameters does not load the methods."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"merging.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names for completion."""
    return sorted({*globals(), *__all__})
