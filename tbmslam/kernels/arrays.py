"""Arrays of zeros. Numba takes eight times as long to compile `numpy.zeros` for a type of array."""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import part

Array = TypeVar("Array", bound=npt.NDArray[np.generic])


@part
def cleared(array: Array) -> Array:
    """Return an array with each item set to zero."""
    array[...] = 0
    return array
