"""Finds of wide searches are accepted only if several of them along the drive agree.

If the drift may be large, many places are similar, and the true place may not be mapped well enough to be found. A
single find is then weak evidence. True finds give the same correction all along the drive. Chance finds give another
correction at every step, and a repetitive corridor gives several corrections at once. (After SeqSLAM, M. Milford and
G. Wyeth, ICRA 2012: places are recognised by sequences.)
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray, IntArray, compose, inverse, wrap_angles


class ClosureVotesConfig(FrozenConfig):
    """Thresholds of single finds of wide searches, and of their agreement."""

    beyond: float = Field(1.0, gt=0, description="search window from which finds need agreement [m]")
    places: int = Field(4, ge=1, description="poses in a submap that are refined")
    min_matched: float = Field(0.3, ge=0, le=1, description="share of a bundle that must lie on surfaces")
    violation_cost: float = Field(4.0, ge=0, description="matched hits that one hit in free space cancels")
    min_vote: float = Field(0.2, ge=0, le=1, description="matched share without weight")
    together: float = Field(0.3, gt=0, description="largest distance between the robot's poses by finds that agree [m]")
    together_rad: float = Field(0.03, gt=0, description="largest rotation between them [rad]")
    apart: float = Field(0.8, gt=0, description="least distance between the robot's poses by finds that contradict [m]")
    stops: int = Field(4, ge=1, description="keyframes at which finds must agree")
    min_sum: float = Field(0.0, ge=0, description="least sum of the best votes that agree")
    margin: float = Field(1.5, ge=1, description="least sum of votes relative to that of any contradicting pose")
    memory: float = Field(12.0, gt=0, description="path over which finds are kept [m]")


class PlacedBundle(NamedTuple):
    """The pose of a keyframe's bundle in a target."""

    keyframe: int
    target: int
    """Indices of the keyframe and the target."""
    anchor: int
    """The keyframe whose laser is the target's frame."""
    pose: SE2
    """Pose of the keyframe in that frame."""
    hessian: FloatArray
    """Curvature (3, 3) of the determined directions."""
    weight: float = 1.0
    """Weight of its vote."""
    violated: float = 0.0
    """Share of the bundle in space that the target knows to be free."""


class ClosureVotes:
    """Collects the finds along a drive, by the length of the path to each keyframe (K,) [m]."""

    def __init__(self, config: ClosureVotesConfig, travelled: FloatArray) -> None:
        self._config = config
        self._travelled = travelled
        self._votes: list[PlacedBundle] = []

    def weight(self, matched: float, violated: float) -> float:
        """Return the weight of a find by its shares of hits on surfaces and in free space; 0 for a weak find."""
        config = self._config
        if matched < config.min_matched:
            return 0.0
        return max(matched - config.violation_cost * violated - config.min_vote, 0.0)

    def add(self, votes: list[PlacedBundle]) -> None:
        """Add the votes of one keyframe, and forget those far behind it."""
        if votes:
            since = self._travelled[votes[0].keyframe] - self._config.memory
            self._votes = [vote for vote in self._votes if self._travelled[vote.keyframe] >= since] + votes

    def elected(self, poses: FloatArray) -> list[PlacedBundle]:
        """Return the votes that agree if they outweigh all others, else none.

        `poses` (K, 3) are the current poses of the laser at the keyframes.
        """
        config = self._config
        stops = np.array([vote.keyframe for vote in self._votes], dtype=np.int64)
        if len(np.unique(stops)) < config.stops:
            return []
        together, apart = self._agreement(poses)
        weights = np.array([vote.weight for vote in self._votes])
        sums = np.array([_sum_of_best(weights[agrees], stops[agrees]) for agrees in together])
        best = int(sums.argmax())
        agreeing = together[best]
        rival = sums[apart[best]].max(initial=0.0)
        if len(np.unique(stops[agreeing])) < config.stops or sums[best] < max(config.margin * rival, config.min_sum):
            return []
        return [vote for vote, agrees in zip(self._votes, agreeing, strict=True) if agrees]

    def rivals(self, elected: list[PlacedBundle], poses: FloatArray) -> FloatArray:
        """Return the corrections (R, 3) of the poses (K, 3) that votes propose and elected votes contradict.

        Corrections are in the frame of the poses. Votes that agree give one.
        """
        together, apart = self._agreement(poses)
        is_elected = np.array([any(vote is chosen for chosen in elected) for vote in self._votes])
        left, chosen = apart[:, is_elected].all(axis=1), []
        while left.any():
            chosen.append(int(left.argmax()))
            left &= ~together[chosen[-1]]
        return self._corrections(poses)[chosen]

    def outweighs(self, elected: list[PlacedBundle], others: list[PlacedBundle]) -> bool:
        """Return whether elected votes outweigh others."""
        own, rival = (
            _sum_of_best(np.array([vote.weight for vote in votes]), np.array([vote.keyframe for vote in votes]))
            for votes in (elected, others)
        )
        return own >= self._config.margin * rival

    def forget(self) -> None:
        """Forget all votes."""
        self._votes = []

    def _agreement(self, poses: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return which votes (V, V) agree, and which contradict, about the robot's pose at the last keyframe."""
        here = compose(self._corrections(poses), poses[self._votes[-1].keyframe][None])
        away = np.hypot(*(here[:, None, :2] - here[None, :, :2]).transpose(2, 0, 1))
        turned = np.abs(wrap_angles(here[:, None, 2] - here[None, :, 2]))
        config = self._config
        return (away <= config.together) & (turned <= config.together_rad), away > config.apart

    def _corrections(self, poses: FloatArray) -> FloatArray:
        """Return how each vote (V, 3) moves the poses (K, 3), in their frame."""
        anchors, stops = [vote.anchor for vote in self._votes], [vote.keyframe for vote in self._votes]
        placed = compose(poses[anchors], np.array([vote.pose for vote in self._votes], dtype=np.float64))
        return compose(placed, inverse(poses[stops]))


def _sum_of_best(weights: FloatArray, stops: IntArray) -> float:
    """Return the sum of the largest weight of each keyframe, so that none votes twice."""
    _, at = np.unique(stops, return_inverse=True)
    largest = np.zeros(at.max(initial=-1) + 1)
    np.maximum.at(largest, at, weights)
    return float(largest.sum())
