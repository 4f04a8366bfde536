"""Occupancies, as other programs' maps hold them, turned into beliefs and back."""

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import Masses, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import FloatArray

RELIABILITY = 0.9
"""How far a map that holds only probabilities is believed: it is evidence, but its author's certainty is lost."""

MIN_BALANCE = 0.1
"""How far the masses of free and occupied must differ for a cell to be one of them; see `occupancy_of`."""
_BAND = 256
"""So many rows of cells are decided at once."""


def occupancy_of(grid: TbmGrid) -> npt.NDArray[np.int8]:
    """Return the occupancy (rows, cols) as map_server publishes it: 0 free, 100 occupied, -1 unknown; row grows with y.

    A cell is occupied where its pignistic probability is above 0.55 and free where it is below 0.45, that is where the
    masses of the two differ by `MIN_BALANCE` of what is not conflict. A cell with hardly any evidence, or with as much
    for as against, is unknown. The bounds lie near one half because the pignistic probability counts half of UNKNOWN
    either way, and free space is learnt slowly: after 100 misses vinySLAM's m(FREE) is 0.23.
    """
    occupancy = np.full(grid.masses.shape[:2], -1, dtype=np.int8)
    for first in range(0, len(occupancy), _BAND):  # whole maps of what is computed would take more memory than the map
        masses, decided = grid.masses[first : first + _BAND], occupancy[first : first + _BAND]
        balance = masses[..., OCCUPIED] - masses[..., FREE]
        needed = MIN_BALANCE * (1.0 - masses[..., CONFLICT])
        decided[balance > needed] = 100
        decided[-balance > needed] = 0
    return occupancy


def masses_from_occupancy(occupancy: npt.NDArray[np.int8]) -> Masses:
    """Return the beliefs (..., 4) of occupancies (...) from 0 to 100, -1 unknown; see `masses_from_probability`."""
    percent = np.arange(-1, 101)
    table = masses_from_probability(percent / 100.0, known=percent >= 0)
    return np.asarray(table[occupancy.astype(np.int16) + 1])


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
