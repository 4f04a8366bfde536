"""Probabilities of being occupied, as other programs' maps hold them, turned into beliefs."""

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import Masses
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import FloatArray

RELIABILITY = 0.9
"""How far a map that holds only probabilities is believed: it is evidence, but its author's certainty is lost."""


def masses_from_probability(probability: FloatArray, known: npt.NDArray[np.bool_]) -> Masses:
    """Return the least committed beliefs whose pignistic value is a given probability, discounted.

    Of all beliefs with pignistic value p, the one with the most mass on UNKNOWN is m(OCCUPIED) = 2p - 1 for p above one
    half, m(FREE) = 1 - 2p below, and the rest on UNKNOWN (Dubois, Prade, Smets, "A definition of subjective
    possibility", 2008): so nothing is claimed that the probability does not say, and p of one half is no evidence. It
    is then discounted by `RELIABILITY`: a certain cell keeps a mass of 0.1 on UNKNOWN, and an unknown one has 1.

    Parameters
    ----------
    probability
        Probability (...) of being occupied, in [0, 1] where `known`.
    known
        Where there is evidence (...).

    Returns
    -------
    Masses (..., 4).
    """
    lean = np.where(known, 2.0 * probability - 1.0, 0.0) * RELIABILITY
    masses: Masses = np.zeros((*lean.shape, 4), dtype=np.float32)
    masses[..., OCCUPIED] = np.maximum(lean, 0.0)
    masses[..., FREE] = np.maximum(-lean, 0.0)
    masses[..., UNKNOWN] = 1.0 - masses[..., OCCUPIED] - masses[..., FREE]
    return masses
