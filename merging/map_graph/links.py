"""Where groups of maps may lie in each other's frames, and what speaks for it: alignments, and ways over others."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from merging.config.groups import GraphConfig
from merging.map_graph.hypothesis import PoseHypothesis, worth_of
from tbmslam.geometry.se2 import SE2, FloatArray, compose

_Indices = npt.NDArray[np.intp]


class GroupLink(NamedTuple):
    """Two groups that may be one.

    Parameters
    ----------
    support
        Log odds of it.
    wall_m
        Agreeing wall [m].
    first, second
        The groups' indices.
    motion
        Where the second lies in the first's frame.
    """

    support: float
    wall_m: float
    first: int
    second: int
    motion: SE2


class GroupLinks:
    """Groups that grow as links join them; what a join does not concern is not looked at again.

    Parameters
    ----------
    groups
        Poses of the maps of each group in its frame; changed as they are joined, and empty once in another.
    offers
        Where maps may lie in each other's frames.
    config
        When two places are one, and how much must speak for a link.
    """

    def __init__(self, groups: Sequence[dict[str, SE2]], offers: Sequence[PoseHypothesis], config: GraphConfig) -> None:
        self.groups, self._offers, self._config = groups, offers, config
        self._found: dict[tuple[int, int], GroupLink] = {}
        links = _Links(groups, offers)
        self._look(links, links.pairs())

    def all(self) -> list[GroupLink]:
        """Return of any two groups the place for which most speaks, where enough does."""
        return [self._found[pair] for pair in sorted(self._found)]

    def join(self, link: GroupLink) -> None:
        """Put the second group of a link into the first."""
        self.groups[link.first].update({n: link.motion @ pose for n, pose in self.groups[link.second].items()})
        self.groups[link.second].clear()
        links = _Links(self.groups, self._offers)
        self._found = {pair: one for pair, one in self._found.items() if link.second not in pair}
        # Only the links to the group, and those that may lead over it, are others than before.
        near = {link.first, *links.neighbours(link.first)}
        self._look(links, [pair for pair in links.pairs() if near.issuperset(pair)])

    def _look(self, links: "_Links", pairs: Sequence[tuple[int, int]]) -> None:
        for pair in pairs:
            best = _best_link(links, *pair, self._config)
            if best is None:
                self._found.pop(pair, None)
            else:
                self._found[pair] = best


class _Links:
    """Offers that join groups, each either way round, sorted by the groups that they lead from and to.

    Where an offer puts the second group in the first's frame is in `motions` (E, 3), with its log odds in `odds` (E,).
    """

    def __init__(self, groups: Sequence[Mapping[str, SE2]], offers: Sequence[PoseHypothesis]) -> None:
        where = {name: index for index, group in enumerate(groups) for name in group}
        found: dict[tuple[int, int], list[tuple[PoseHypothesis, SE2]]] = {}
        for offer in offers:
            ends = tuple(where.get(name) for name in offer.pair)
            for first, second in (ends, ends[::-1]):
                if first is not None and second is not None and first != second:
                    motion = _between(groups[first], groups[second], offer)
                    found.setdefault((first, second), []).append((offer, motion))
        links = [link for pair in sorted(found) for link in found[pair]]
        self.offers = [offer for offer, _ in links]
        self.places = [place for _, place in links]
        self.motions = np.array(self.places, dtype=np.float64).reshape(-1, 3)
        self.odds = np.array([offer.odds for offer in self.offers])
        self.probabilities = np.array([offer.probability for offer in self.offers])
        self.accepted = np.array([offer.accepted for offer in self.offers], dtype=bool)
        counts = np.zeros((len(groups), len(groups)), dtype=np.intp)
        for pair, joining in found.items():
            counts[pair] = len(joining)
        self._counts, self._begins = counts, np.cumsum(counts).reshape(counts.shape) - counts

    def pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of groups that offers join, the first group before the second."""
        return [(int(first), int(second)) for first, second in np.argwhere(np.triu(self._counts))]

    def neighbours(self, group: int) -> list[int]:
        """Return the groups that offers join with a group."""
        return [int(other) for other in np.flatnonzero(self._counts[group])]

    def between(self, first: int, second: int) -> slice:
        """Return which links lead from one group to another."""
        begin = int(self._begins[first, second])
        return slice(begin, begin + int(self._counts[first, second]))

    def ways(self, first: int, second: int) -> tuple[_Indices, _Indices]:
        """Return the two halves (W,) of every way over a third group: those of one group together, in order."""
        there, onward = self._counts[first], self._counts[:, second]
        others = np.flatnonzero((there > 0) & (onward > 0))
        halves = np.repeat(others, there[others])  # the groups that every first half leads to
        each = np.arange(len(halves)) - np.repeat(np.cumsum(there[others]) - there[others], there[others])
        ways = np.repeat(np.arange(len(halves)), onward[halves])
        last = np.arange(len(ways)) - np.repeat(np.cumsum(onward[halves]) - onward[halves], onward[halves])
        return (self._begins[first, halves] + each)[ways], self._begins[halves[ways], second] + last


def _best_link(links: _Links, first: int, second: int, config: GraphConfig) -> GroupLink | None:
    """Return the place of the second group in the first's frame for which most speaks; None if too little does."""
    direct = links.between(first, second)
    supports = _supports(links, direct, links.ways(first, second), config)
    joints = [
        GroupLink(support, links.offers[index].wall_m, first, second, links.places[index])
        for index, support in enumerate(supports, direct.start)
        if support >= config.min_support
    ]
    return max(joints, key=lambda joint: joint[:2]) if joints else None


def _supports(links: _Links, direct: slice, ways: tuple[_Indices, _Indices], config: GraphConfig) -> list[float]:
    """Return the log odds of each direct place: what leads to it, less what was accepted and leads elsewhere.

    Maps of one place are no witnesses of their own: what looks alike in one of them looks alike in all. So what leads
    to a place as well adds little, the less, the less likely it is right; and refused places, which may all do so for
    one reason, never add more than one that is sure.
    """
    there, onward = ways
    places, odds = links.motions[direct], links.odds[direct]
    # A way is right where both of its halves are.
    way_odds = np.minimum(links.odds[there], links.odds[onward]) - math.log(2.0)
    same = _are_same(places, places, config)
    same_way = _are_same(places, compose(links.motions[there], links.motions[onward]), config)
    also = np.concatenate((links.probabilities[direct], links.probabilities[there] * links.probabilities[onward]))
    worth, at_most = worth_of(also, config.coincidence), -math.log(config.coincidence)
    against, doubts = links.accepted[direct], way_odds > 0.0
    sure = np.concatenate((against, links.accepted[there] & links.accepted[onward]))
    supports = []
    for row, row_ways in zip(same, same_way, strict=True):
        best = np.flatnonzero(row)[odds[row].argmax()]
        leading = np.concatenate((row, row_ways))
        leading[best] = False
        further = worth[leading & sure].sum() + min(worth[leading & ~sure].sum(), at_most)
        contrary = odds[~row & against].sum() + way_odds[~row_ways & doubts].sum()
        supports.append(float(odds[best] + further - contrary))
    return supports


def _are_same(places: FloatArray, others: FloatArray, config: GraphConfig) -> npt.NDArray[np.bool_]:
    """Tell (D, W) which of some motions (W, 3) name the same place as each of others (D, 3); see `is_same_place`."""
    x, y, turn = (others[:, axis] - places[:, axis, None] for axis in range(3))
    turned = np.abs(turn)  # of two angles within half a circle, less than a whole one
    alike = (turned <= config.same_rad) | (turned >= 2.0 * math.pi - config.same_rad)
    return np.asarray(alike & (x * x + y * y <= config.same_m**2))


def _between(first: Mapping[str, SE2], second: Mapping[str, SE2], offer: PoseHypothesis) -> SE2:
    """Return where an offer that joins two groups puts the second in the first's frame."""
    target, source = offer.pair
    if target in first:
        return first[target] @ offer.motion @ second[source].inverse()
    return first[source] @ offer.motion.inverse() @ second[target].inverse()
