"""Rules by which the beliefs of any number of sources about a cell become one.

Every rule here takes its sources in any order: those that are not associative in pairs (Dubois and Prade, Yager, the
average) are computed for all sources at once, from sums and products that can be kept as sources come.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from merging.config import Rule
from tbmslam.belief import CONFLICT, FREE, OCCUPIED, UNKNOWN, conjunctive, dempster, disjunctive
from tbmslam.se2 import FloatArray

_Pairwise = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FusionRule:
    """How one more source changes what is kept of a cell, and what is made of it in the end.

    Parameters
    ----------
    width
        Numbers kept of each cell.
    start
        What is kept (N, width) of the first source's masses (N, 4).
    add
        What is kept after one more source: of what was kept (N, width) and its masses (N, 4).
    finish
        The fused masses (N, 4) of what was kept (N, width) of so many sources (N,).
    """

    width: int
    start: Callable[[FloatArray], FloatArray]
    add: _Pairwise
    finish: Callable[[FloatArray, FloatArray], FloatArray]


def _associative(combine: _Pairwise) -> FusionRule:
    def add(kept: FloatArray, masses: FloatArray) -> FloatArray:
        together = combine(kept, masses)
        # Sums of masses multiply: a rounding of each map would grow with their number.
        return np.asarray(together / together.sum(axis=-1, keepdims=True))

    return FusionRule(4, lambda masses: masses, add, lambda kept, _: kept)


def _yager(kept: FloatArray, _: FloatArray) -> FloatArray:
    """Give the conflict of all sources to UNKNOWN (Yager 1987)."""
    fused = kept.copy()
    fused[:, UNKNOWN] += fused[:, CONFLICT]
    fused[:, CONFLICT] = 0.0
    return fused


def _start_dubois_prade(masses: FloatArray) -> FloatArray:
    return np.hstack((masses, masses, masses[:, [FREE, OCCUPIED]]))


def _add_dubois_prade(kept: FloatArray, masses: FloatArray) -> FloatArray:
    both, either, same = kept[:, :4], kept[:, 4:8], kept[:, 8:]
    return np.hstack((conjunctive(both, masses), disjunctive(either, masses), same * masses[:, [FREE, OCCUPIED]]))


def _dubois_prade(kept: FloatArray, _: FloatArray) -> FloatArray:
    """Take what the sources have in common, and where that is nothing, what any of them holds (Dubois, Prade 1988).

    The mass of a set sums the products whose intersection it is, and those with an empty intersection whose union it
    is. Of the products with union FREE, all but the one where every source says FREE have an empty intersection.
    """
    both, either, same = kept[:, :4], kept[:, 4:8], kept[:, 8:]
    fused = np.empty_like(both)
    mixed = both[:, [FREE, OCCUPIED]] - same  # FREE (OCCUPIED) in common, though some say UNKNOWN
    fused[:, [FREE, OCCUPIED]] = both[:, [FREE, OCCUPIED]] + either[:, [FREE, OCCUPIED]] - same
    fused[:, UNKNOWN] = either[:, UNKNOWN] - mixed.sum(axis=1)
    fused[:, CONFLICT] = either[:, CONFLICT]
    return np.maximum(fused, 0.0)


def _average(kept: FloatArray, count: FloatArray) -> FloatArray:
    return np.asarray(kept / count[:, None])


RULES: dict[Rule, FusionRule] = {
    "disjunctive": _associative(disjunctive),
    "conjunctive": _associative(conjunctive),
    "dempster": _associative(dempster),
    "dubois-prade": FusionRule(10, _start_dubois_prade, _add_dubois_prade, _dubois_prade),
    "yager": FusionRule(4, lambda masses: masses, conjunctive, _yager),
    "average": FusionRule(4, lambda masses: masses, lambda kept, masses: kept + masses, _average),
}
