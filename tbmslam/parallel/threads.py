"""Work shared by threads of this process, for compiled code, which lets go of the interpreter."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


def in_threads(call: Callable[[_T], _R], items: Sequence[_T]) -> list[_R]:
    """Return what a call makes of each item, in the items' order; on all cores, one after another where there is one.

    The calls must not write what others read.
    """
    threads = min(len(items), os.cpu_count() or 1)
    if threads < 2:
        return [call(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(call, items))
