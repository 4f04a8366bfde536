"""How far two maps agree, cell by cell, and the answer that a method makes of it."""

from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_UNKNOWN, CellStates
from merging.baselines.placing import Placing
from merging.config import MergeConfig
from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class Agreement:
    """Of the source's known cells, the shares that agree with, and that contradict, the target's.

    Parameters
    ----------
    agreeing, disagreeing
        One for each place (K,).
    """

    agreeing: FloatArray
    disagreeing: FloatArray

    @classmethod
    def of(
        cls, target: CellStates, source: CellStates, placing: Placing, places: FloatArray, limit: int | None = None
    ) -> "Agreement":
        """Lay the source onto the target at each place (K, 3), with all of its known cells or about `limit`."""
        points, states = source.known
        every = max(1, len(points) // limit) if limit is not None else 1
        points, states = points[::every], states[::every]
        there = target.field.at(placing.into_target(points, places))
        agreeing = np.mean(there == states, axis=1)
        return cls(agreeing, np.mean(there != IS_UNKNOWN, axis=1) - agreeing)

    def index(self) -> FloatArray:
        """Return the acceptance index (K,), ai = 1 - agr / (agr + dis): 0 where all agree, 1 where nothing meets."""
        met = self.agreeing + self.disagreeing
        return 1.0 - np.divide(self.agreeing, met, out=np.zeros_like(met), where=met > 0.0)


def answer(
    method: str,
    maps: tuple[CellStates, CellStates],
    placing: Placing,
    place: FloatArray,
    measure: tuple[str, bool],
    config: MergeConfig,
) -> Alignment:
    """Return a method's answer: its place, accepted if its own measure is good enough and the maps overlap enough.

    Parameters
    ----------
    maps
        The target and the source.
    place
        The best place (3,).
    measure
        The method's measure in words, and whether it suffices.
    """
    target, source = maps
    agreement = Agreement.of(target, source, placing, place[None])
    both = float(agreement.agreeing[0] + agreement.disagreeing[0])
    cells = [int(np.count_nonzero(one.states != IS_UNKNOWN)) for one in maps]
    share, needed = both * cells[1] / min(cells), config.baselines.min_overlap_share
    words, good = measure
    reason = words if share >= needed else f"the maps overlap by {share:.0%}, under {needed:.0%}"
    return Alignment(
        method=method,
        accepted=good and share >= needed,
        reason=reason,
        T_target_source=placing.motion(place),
        overlap_m2=both * cells[1] * source.geometry.resolution**2,
    )
