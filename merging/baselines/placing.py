"""Where a source may lie: a shift between the centroids of two maps, and a turn about the source's."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from merging.baselines.cell_states import CellStates, Points
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

Score = Callable[[FloatArray], FloatArray]
"""Rates places (K, 3), the more the better (K,)."""


@dataclass(frozen=True)
class Placing:
    """Carries points between two maps under places (K, 3): the shift x, y [m] and the turn [rad].

    Parameters
    ----------
    target_centre, source_centre
        The centroids of what the maps know, each in its own frame.
    reach_m
        Radius of the shifts under which the maps meet at all.
    """

    target_centre: complex
    source_centre: complex
    reach_m: float

    @classmethod
    def of(cls, target: CellStates, source: CellStates) -> "Placing":
        """Look at two maps."""
        return cls(target.centre, source.centre, target.radius_m + source.radius_m)

    def into_target(self, points: Points, places: FloatArray) -> Points:
        """Carry the source's points (N,) into the target's frame under each place (K, N)."""
        turns, shifts = np.exp(1j * places[:, 2]), places[:, 0] + 1j * places[:, 1] + self.target_centre
        moved = (points - self.source_centre).astype(np.complex64) * turns.astype(np.complex64)[:, None]
        return np.asarray(moved + shifts.astype(np.complex64)[:, None])

    def into_source(self, points: Points, places: FloatArray) -> Points:
        """Carry the target's points (N,) into the source's frame under each place (K, N)."""
        turns, shifts = np.exp(-1j * places[:, 2]), places[:, 0] + 1j * places[:, 1]
        moved = (points - self.target_centre).astype(np.complex64) - shifts.astype(np.complex64)[:, None]
        return np.asarray(moved * turns.astype(np.complex64)[:, None] + np.complex64(self.source_centre))

    def motion(self, place: FloatArray) -> SE2:
        """Return T_target_source of one place (3,)."""
        x, y, theta = (float(value) for value in place)
        translation = self.target_centre + complex(x, y) - np.exp(1j * theta) * self.source_centre
        return SE2(float(translation.real), float(translation.imag), wrap_angle(theta))


def climb(score: Score, places: FloatArray, step_m: float, step_rad: float, halvings: int = 5) -> FloatArray:
    """Move places (K, 3) uphill along x, y and the turn, in steps that halve where none leads up."""
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
