"""Many maps whose relative poses nobody knows become one."""

from merging.aligner import align
from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.merger import Merge, merge

__all__ = ["Alignment", "Merge", "MergeConfig", "align", "merge"]
