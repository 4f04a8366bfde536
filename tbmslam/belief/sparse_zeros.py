"""Arrays of zeros that take memory only where they are written."""

import math
import mmap
from typing import TypeVar

import numpy as np
import numpy.typing as npt

_Scalar = TypeVar("_Scalar", bound=np.generic)


def sparse_zeros(shape: tuple[int, ...], dtype: type[_Scalar], least_bytes: int = 1 << 22) -> npt.NDArray[_Scalar]:
    """Return zeros of a shape; a page of 4 kB takes memory when something is written to it.

    `numpy.zeros` of a large array takes pages of 2 MB, so one cell that is written takes the memory of 36 rows of a map
    of 7000 columns. Large pages are faster to access; so arrays below `least_bytes` are those of `numpy.zeros`. It asks
    for large pages from the default on.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < least_bytes or not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape, dtype=dtype)
    memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE)
    memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, dtype=dtype).reshape(shape)
