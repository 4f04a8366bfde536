"""Merges maps with unknown relative poses into one map.

The names below are the interface for notebooks. Each is loaded at its first use.
"""

from typing import TYPE_CHECKING

from tbmslam.lazy_names import lazy_names

if TYPE_CHECKING:
    from merging.alignment import Alignment
    from merging.config import MergeConfig
    from merging.merger import Merge, align, merge

__all__ = ["Alignment", "Merge", "MergeConfig", "align", "merge"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {"Alignment": ".alignment", "Merge": ".merger", "MergeConfig": ".config", "align": ".merger", "merge": ".merger"},
)
