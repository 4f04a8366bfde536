"""Finds of wide searches, held back until several of them along the way say the same.

Where a drive may have drifted far, many places look like the one that is searched for, and the true one may not even
be known well enough to be found. A single find proves little then. But what is right moves with the robot: all along
the way it says the same correction, while chance says another one at every step, and a corridor that repeats itself
says several at once. (After SeqSLAM, M. Milford and G. Wyeth, ICRA 2012: places are recognised by sequences.)
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, compose, inverse, wrap_angles


class ClosureVotesConfig(FrozenConfig):
    """What finds of wide searches must show, alone and together."""

    beyond: float = Field(1.0, gt=0, description="search window from which on finds are held back [m]")
    places: int = Field(4, ge=1, description="places in a submap that are looked at closely")
    min_matched: float = Field(0.3, ge=0, le=1, description="share of a bundle that must lie on surfaces")
    violation_cost: float = Field(4.0, ge=0, description="matched hits that one in known free space outweighs")
    min_vote: float = Field(0.2, ge=0, le=1, description="of the share matched, what counts for nothing")
    together: float = Field(0.3, gt=0, description="finds that put the robot so near to each other agree [m]")
    together_rad: float = Field(0.03, gt=0, description="and turn it alike [rad]")
    apart: float = Field(0.8, gt=0, description="finds that put the robot so far from each other contradict [m]")
    stops: int = Field(4, ge=1, description="places on the way at which finds must agree")
    min_sum: float = Field(0.0, ge=0, description="weight of the best votes of all places that agree, together")
    margin: float = Field(1.5, ge=1, description="votes for one place over those for any other")
    memory: float = Field(12.0, gt=0, description="length of way over which finds are remembered [m]")


class PlacedBundle(NamedTuple):
    """Where a keyframe's bundle lies in a target."""

    keyframe: int
    target: int
    """Their numbers."""
    anchor: int
    """The keyframe in whose frame the target is."""
    pose: SE2
    """Where the keyframe lies there."""
    hessian: FloatArray
    """Curvature (3, 3) of the directions that are determined."""
    weight: float = 1.0
    """How much it counts beside others."""
    violated: float = 0.0
    """Share of the bundle in space that the target knows to be free."""


class ClosureVotes:
    """Collects the finds along a drive.

    Parameters
    ----------
    travelled
        Length of the way up to each keyframe (K,) [m].
    """

    def __init__(self, config: ClosureVotesConfig, travelled: FloatArray) -> None:
        self._config = config
        self._travelled = travelled
        self._votes: list[PlacedBundle] = []

    def weight(self, matched: float, violated: float) -> float:
        """Return the weight of a find by its shares of hits on surfaces and in free space; 0: it does not count."""
        config = self._config
        if matched < config.min_matched:
            return 0.0
        return max(matched - config.violation_cost * violated - config.min_vote, 0.0)

    def add(self, votes: list[PlacedBundle]) -> None:
        """Add the votes of one keyframe, and forget those of places far behind it."""
        if votes:
            since = self._travelled[votes[0].keyframe] - self._config.memory
            self._votes = [vote for vote in self._votes if self._travelled[vote.keyframe] >= since] + votes

    def elected(self, poses: FloatArray) -> list[PlacedBundle]:
        """Return the votes that agree, where they outvote all others; else none.

        Parameters
        ----------
        poses
            Poses (K, 3) of the laser at the keyframes as they are thought to be now.
        """
        config = self._config
        stops = np.array([vote.keyframe for vote in self._votes], dtype=np.int64)
        if len(np.unique(stops)) < config.stops:
            return []
        together, apart = self._agreement(poses, stops)
        weights = np.array([vote.weight for vote in self._votes])
        sums = np.array([_sum_of_best(weights[agrees], stops[agrees]) for agrees in together])
        best = int(sums.argmax())
        agreeing = together[best]
        rival = sums[apart[best]].max(initial=0.0)
        if len(np.unique(stops[agreeing])) < config.stops or sums[best] < max(config.margin * rival, config.min_sum):
            return []
        return [vote for vote, agrees in zip(self._votes, agreeing, strict=True) if agrees]

    def forget(self) -> None:
        """Forget all votes."""
        self._votes = []

    def _agreement(
        self, poses: FloatArray, stops: npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return which votes (V, V) agree, and which contradict, on where the robot is at the last stop."""
        found = compose(
            poses[[vote.anchor for vote in self._votes]],
            np.array([vote.pose for vote in self._votes], dtype=np.float64),
        )
        here = compose(compose(found, inverse(poses[stops])), poses[stops[-1]][None])
        away = np.hypot(*(here[:, None, :2] - here[None, :, :2]).transpose(2, 0, 1))
        turned = np.abs(wrap_angles(here[:, None, 2] - here[None, :, 2]))
        config = self._config
        return (away <= config.together) & (turned <= config.together_rad), away > config.apart


def _sum_of_best(weights: FloatArray, stops: npt.NDArray[np.int64]) -> float:
    """Return the sum of the largest weight at each stop: no stop votes twice."""
    _, at = np.unique(stops, return_inverse=True)
    largest = np.zeros(at.max(initial=-1) + 1)
    np.maximum.at(largest, at, weights)
    return float(largest.sum())
