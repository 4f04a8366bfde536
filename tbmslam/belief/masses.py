"""The algebra of the Transferable Belief Model on the frame {free, occupied}.

A belief is four masses in an array (..., 4), one per subset of the frame, and the index of a mass is its subset
written in bits: CONFLICT (nothing) 0, FREE 1, OCCUPIED 2, UNKNOWN (either) 3. Intersection of subsets is then ``&`` of
indices and union is ``|``. All masses are non-negative and add up to one.

Sources: Smets and Kennes, "The transferable belief model", 1994; equation numbers are those of Dobrokhvalov and
Filatov, "Merging Occupancy Grid Map based on Transferable Belief Model", 2021.
"""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray

CONFLICT, FREE, OCCUPIED, UNKNOWN = 0, 1, 2, 3
VACUOUS: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])
"""The belief of a source that knows nothing."""
VACUOUS.flags.writeable = False


def conjunctive(first: npt.ArrayLike, second: npt.ArrayLike) -> FloatArray:
    """Combine two sources that are both reliable, eq. 5: m(A) = sum of m1(B) m2(C) over B and C with B & C = A.

    Parameters
    ----------
    first, second
        Masses (..., 4); shapes broadcast.

    Returns
    -------
    Masses (..., 4); disagreement ends in CONFLICT.
    """
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


def disjunctive(first: npt.ArrayLike, second: npt.ArrayLike) -> FloatArray:
    """Combine two sources of which at least one is reliable, eq. 6: m(A) sums m1(B) m2(C) over B and C with B | C = A.

    Parameters
    ----------
    first, second
        Masses (..., 4); shapes broadcast.

    Returns
    -------
    Masses (..., 4); disagreement ends in UNKNOWN.
    """
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


def normalise(masses: npt.ArrayLike) -> FloatArray:
    """Share the conflict out among the other masses in their proportion; full conflict becomes UNKNOWN."""
    m = _masses(masses)
    rest = m[..., FREE] + m[..., OCCUPIED] + m[..., UNKNOWN]
    shared = np.zeros_like(m)
    known = rest > 0.0
    np.divide(m[..., 1:], rest[..., None], out=shared[..., 1:], where=known[..., None])
    shared[..., UNKNOWN] = np.where(known, shared[..., UNKNOWN], 1.0)
    return shared


def dempster(first: npt.ArrayLike, second: npt.ArrayLike) -> FloatArray:
    """Combine by Dempster's rule: the conjunctive rule, then the conflict normalised away."""
    return normalise(conjunctive(first, second))


def discount(masses: npt.ArrayLike, reliability: npt.ArrayLike) -> FloatArray:
    """Weaken a source that is reliable with probability `reliability` (Shafer 1976): the rest goes to UNKNOWN."""
    m, trust = _masses(masses), np.asarray(reliability, dtype=np.float64)
    if np.any((trust < 0.0) | (trust > 1.0)):
        raise ValueError(f"reliability must lie within [0, 1], got {reliability!r}")
    weakened = m * trust[..., None]
    weakened[..., UNKNOWN] += (1.0 - trust) * m.sum(axis=-1)
    return weakened


def pignistic(masses: npt.ArrayLike) -> FloatArray:
    """Return the probability (...) of OCCUPIED to bet on: BetP(x) = sum of m(A)/|A| over A containing x.

    The conflict is normalised first; a cell in full conflict is a fair bet.
    """
    m = _masses(masses)
    rest = m[..., FREE] + m[..., OCCUPIED] + m[..., UNKNOWN]
    bet = m[..., OCCUPIED] + 0.5 * m[..., UNKNOWN]
    probability: FloatArray = np.full(m.shape[:-1], 0.5)
    np.divide(bet, rest, out=probability, where=rest > 0.0)
    return probability


def _masses(values: npt.ArrayLike) -> FloatArray:
    masses = np.asarray(values, dtype=np.float64)
    if masses.ndim == 0 or masses.shape[-1] != 4:
        raise ValueError(f"masses must have four entries in the last axis, got shape {masses.shape}")
    return masses
