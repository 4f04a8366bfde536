"""Poses of a source map as a shift between centroids and a rotation, and the agreement of two maps there."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_UNKNOWN, CellStates, Points
from merging.config import MergeConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

Score = Callable[[FloatArray], FloatArray]
"""Returns the scores (K,) of placements (K, 3)."""


@dataclass(frozen=True)
class Placing:
    """Transforms points between two maps under placements (K, 3): a shift x, y [m] and a rotation [rad].

    Parameters
    ----------
    target_centre, source_centre
        Centroids of the known cells of the maps, each in its own frame.
    reach_m
        Largest shift at which the maps can overlap.
    """

    target_centre: complex
    source_centre: complex
    reach_m: float

    @classmethod
    def of(cls, target: CellStates, source: CellStates) -> "Placing":
        """Return the placing of two maps."""
        return cls(target.centre, source.centre, target.radius_m + source.radius_m)

    def into_target(self, points: Points, places: FloatArray) -> Points:
        """Return the source's points (N,) in the target's frame under each placement (K, N)."""
        turns, shifts = np.exp(1j * places[:, 2]), places[:, 0] + 1j * places[:, 1] + self.target_centre
        moved = (points - self.source_centre).astype(np.complex64) * turns.astype(np.complex64)[:, None]
        return np.asarray(moved + shifts.astype(np.complex64)[:, None])

    def into_source(self, points: Points, places: FloatArray) -> Points:
        """Return the target's points (N,) in the source's frame under each placement (K, N)."""
        turns, shifts = np.exp(-1j * places[:, 2]), places[:, 0] + 1j * places[:, 1]
        moved = (points - self.target_centre).astype(np.complex64) - shifts.astype(np.complex64)[:, None]
        return np.asarray(moved * turns.astype(np.complex64)[:, None] + np.complex64(self.source_centre))

    def motion(self, place: FloatArray) -> SE2:
        """Return T_target_source of a placement (3,)."""
        x, y, theta = (float(value) for value in place)
        translation = self.target_centre + complex(x, y) - np.exp(1j * theta) * self.source_centre
        return SE2(float(translation.real), float(translation.imag), wrap_angle(theta))


def climb(score: Score, places: FloatArray, step_m: float, step_rad: float, halvings: int = 5) -> FloatArray:
    """Improve placements (K, 3) by steps along x, y and the rotation; steps are halved if none improves the score."""
    places, values = places.copy(), score(places)
    steps = np.tile((step_m, step_m, step_rad), (len(places), 1))
    directions = np.concatenate((np.eye(3), -np.eye(3)))
    for _ in range(4 * halvings):
        around = places[:, None] + directions * steps[:, None]
        found = score(around.reshape(-1, 3)).reshape(len(places), 6)
        best = found.argmax(axis=1)
        better = found[np.arange(len(places)), best] > values
        places[better] = around[np.arange(len(places)), best][better]
        values = np.where(better, found.max(axis=1), values)
        steps[~better] /= 2.0
        if steps[:, 0].max() < step_m / 2.0**halvings:
            break
    return places


@dataclass(frozen=True)
class Agreement:
    """Shares of the source's known cells that agree with the target's, and that contradict them.

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
        """Compare the source with the target at placements (K, 3), by all of its known cells or about `limit`."""
        points, states = source.known
        every = max(1, len(points) // limit) if limit is not None else 1
        points, states = points[::every], states[::every]
        there = target.field.at(placing.into_target(points, places))
        agreeing = np.mean(there == states, axis=1)
        return cls(agreeing, np.mean(there != IS_UNKNOWN, axis=1) - agreeing)

    def index(self) -> FloatArray:
        """Return the acceptance index (K,), ai = 1 - agr / (agr + dis): 0 if all agree, 1 without overlap."""
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
    """Return a method's alignment, which is accepted if its own measure and the overlap suffice.

    Parameters
    ----------
    maps
        The target and the source.
    place
        The best place (3,).
    measure
        The method's measure as text, and whether it suffices.
    """
    target, source = maps
    agreement = Agreement.of(target, source, placing, place[None])
    both = float(agreement.agreeing[0] + agreement.disagreeing[0])
    cells = [int(np.count_nonzero(side.states != IS_UNKNOWN)) for side in maps]
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
