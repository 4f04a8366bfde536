"""The rules of the Transferable Belief Model, written for reading: plain twins of the kernels.

Sources: Smets and Kennes, "The transferable belief model", 1994; equation numbers are those of Dobrokhvalov and
Filatov, "Merging Occupancy Grid Map based on Transferable Belief Model", 2021.
"""

import numpy as np

from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, _masses


def conjunctive(first, second):
    """Combine two reliable sources (..., 4), eq. 5: m(A) = sum of m1(B) m2(C) over B and C with B & C = A."""
    a, b = _masses(first), _masses(second)
    combined = np.empty(np.broadcast_shapes(a.shape, b.shape))
    # In commonalities q(A) = sum of m(B) over B containing A the rule is a plain product (Smets 1990).
    combined[..., UNKNOWN] = a[..., UNKNOWN] * b[..., UNKNOWN]
    for atom in (FREE, OCCUPIED):
        combined[..., atom] = (
            a[..., atom] * b[..., atom] + a[..., atom] * b[..., UNKNOWN] + a[..., UNKNOWN] * b[..., atom]
        )
    combined[..., CONFLICT] = (
        a[..., CONFLICT] * b.sum(axis=-1)
        + (a.sum(axis=-1) - a[..., CONFLICT]) * b[..., CONFLICT]
        + a[..., FREE] * b[..., OCCUPIED]
        + a[..., OCCUPIED] * b[..., FREE]
    )
    return combined


def disjunctive(first, second):
    """Combine sources (..., 4) with a reliable one, eq. 6: m(A) = sum of m1(B) m2(C) over B and C with B | C = A."""
    a, b = _masses(first), _masses(second)
    combined = np.empty(np.broadcast_shapes(a.shape, b.shape))
    combined[..., CONFLICT] = a[..., CONFLICT] * b[..., CONFLICT]
    for atom in (FREE, OCCUPIED):
        combined[..., atom] = (
            a[..., atom] * b[..., atom] + a[..., atom] * b[..., CONFLICT] + a[..., CONFLICT] * b[..., atom]
        )
    combined[..., UNKNOWN] = (
        a[..., UNKNOWN] * b.sum(axis=-1)
        + (a.sum(axis=-1) - a[..., UNKNOWN]) * b[..., UNKNOWN]
        + a[..., FREE] * b[..., OCCUPIED]
        + a[..., OCCUPIED] * b[..., FREE]
    )
    return combined


def normalise(masses):
    """Share the conflict out among the other masses in their proportion; full conflict becomes UNKNOWN."""
    m = _masses(masses)
    rest = m[..., FREE] + m[..., OCCUPIED] + m[..., UNKNOWN]
    shared = np.zeros_like(m)
    known = rest > 0.0
    np.divide(m[..., 1:], rest[..., None], out=shared[..., 1:], where=known[..., None])
    shared[..., UNKNOWN] = np.where(known, shared[..., UNKNOWN], 1.0)
    return shared


def dempster(first, second):
    """Combine by Dempster's rule: the conjunctive rule, then the conflict normalised away."""
    return normalise(conjunctive(first, second))


def discount(masses, reliability):
    """Weaken a source that is reliable with probability `reliability` (Shafer 1976): the rest goes to UNKNOWN."""
    m, trust = _masses(masses), np.asarray(reliability, dtype=np.float64)
    if np.any((trust < 0.0) | (trust > 1.0)):
        raise ValueError(f"reliability must lie within [0, 1], got {reliability!r}")
    weakened = m * trust[..., None]
    weakened[..., UNKNOWN] += (1.0 - trust) * m.sum(axis=-1)
    return weakened
