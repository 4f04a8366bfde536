"""Masses of the Transferable Belief Model on the frame {free, occupied}.

A belief is four masses in an array (..., 4), one per subset of the frame, and the index of a mass is its subset
written in bits: CONFLICT (nothing) 0, FREE 1, OCCUPIED 2, UNKNOWN (either) 3. Intersection of subsets is then ``&`` of
indices and union is ``|``. All masses are non-negative and add up to one.

Source: Smets and Kennes, "The transferable belief model", 1994. The rules that combine beliefs are kernels, see
`tbmslam.kernels.grids.fusion`; their plain twins are in the tests.
"""

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray

Masses = npt.NDArray[np.float32]
"""Masses (rows, cols, 4) of the cells of a grid."""
CONFLICT, FREE, OCCUPIED, UNKNOWN = 0, 1, 2, 3
VACUOUS: FloatArray = np.array([0.0, 0.0, 0.0, 1.0])
"""The belief without any knowledge."""
VACUOUS.flags.writeable = False


def pignistic(masses: npt.ArrayLike) -> FloatArray:
    """Return the probability (...) of OCCUPIED to bet on: BetP(x) = sum of m(A)/|A| over A containing x.

    The conflict is normalised first; a cell in full conflict is a fair bet.
    """
    m = np.asarray(masses, dtype=np.float64)
    if m.ndim == 0 or m.shape[-1] != 4:
        raise ValueError(f"masses must have four entries in the last axis, got shape {m.shape}")
    rest = m[..., FREE] + m[..., OCCUPIED] + m[..., UNKNOWN]
    bet = m[..., OCCUPIED] + 0.5 * m[..., UNKNOWN]
    probability: FloatArray = np.full(m.shape[:-1], 0.5)
    np.divide(bet, rest, out=probability, where=rest > 0.0)
    return probability
