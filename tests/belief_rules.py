"""The rules of the Transferable Belief Model as their definitions say: plain twins of the kernels.

Sources: Smets and Kennes, "The transferable belief model", 1994; equation numbers are those of Dobrokhvalov and
Filatov, "Merging Occupancy Grid Map based on Transferable Belief Model", 2021.
"""

from functools import cache
from operator import and_, or_

import numpy as np

from tbmslam.belief.masses import CONFLICT, UNKNOWN


def conjunctive(first, second):
    """Combine two reliable sources (..., 4), eq. 5: m(A) = sum of m1(B) m2(C) over B and C with B & C = A."""
    return _combined(first, second, and_)


def disjunctive(first, second):
    """Combine sources (..., 4) with a reliable one, eq. 6: m(A) = sum of m1(B) m2(C) over B and C with B | C = A."""
    return _combined(first, second, or_)


def _combined(first, second, set_operation):
    a, b = (np.asarray(masses, dtype=np.float64) for masses in (first, second))
    products = a[..., :, None] * b[..., None, :]
    return products.reshape(*products.shape[:-2], 16) @ _destinations(set_operation)


@cache
def _destinations(set_operation):
    """Return which mass (4) each product (16) of a subset of one source and one of the other adds to."""
    return np.array([np.eye(4)[set_operation(subset, other)] for subset in range(4) for other in range(4)])


def normalise(masses):
    """Share the conflict out among the other masses in their proportion; full conflict becomes UNKNOWN."""
    shared = np.array(masses, dtype=np.float64)
    shared[..., CONFLICT] = 0.0
    rest = shared.sum(axis=-1, keepdims=True)
    shared[..., UNKNOWN] += rest[..., 0] == 0.0
    return shared / np.where(rest > 0.0, rest, 1.0)


def dempster(first, second):
    """Combine by Dempster's rule: the conjunctive rule, then the conflict normalised away."""
    return normalise(conjunctive(first, second))


def discount(masses, reliability):
    """Weaken a source that is reliable with probability `reliability` (Shafer 1976): the rest goes to UNKNOWN."""
    trust = np.asarray(reliability, dtype=np.float64)
    weakened = np.asarray(masses, dtype=np.float64) * trust[..., None]
    weakened[..., UNKNOWN] += 1.0 - trust
    return weakened
