"""Groups of maps, each as one map, aligned once more.

A map that shares too little with any other one may share enough with what the others are together: who merged those
first, and then it, would find it. So groups are merged, each for itself, and aligned as if each were one map.
"""

import itertools
import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.exactness import Covariance, seen_from
from merging.findings import Findings
from merging.map_graph import Group
from merging.whole_groups import align_wholes, by_what_they_know, names_in, wholes_of
from merging.workforce import Workforce
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2

logger = logging.getLogger(__name__)

Members = frozenset[frozenset[str]]
"""The maps of two groups."""


@dataclass(frozen=True)
class GroupLook:
    """Two groups that were aligned.

    Parameters
    ----------
    pair
        The maps that know most of both, in the order of all maps.
    alignment
        Where the second of these lies in the first's frame; what speaks for it is what the groups say.
    grids
        What it was judged by: both groups' grids, in these maps' frames.
    """

    pair: Pair
    alignment: Alignment
    grids: tuple[TbmGrid, TbmGrid]


def with_groups_as_wholes(found: Findings, config: MergeConfig, workforce: Workforce) -> Findings:
    """Add how groups lie to each other, the surest first."""
    tried = set[Members]()
    while True:
        look, now_tried = look_at_groups(found, config, workforce, tried)
        tried |= now_tried
        if look is None:
            return found
        found = found.with_aligned({look.pair: look.alignment}, {look.pair: look.grids})


def look_at_groups(
    found: Findings,
    config: MergeConfig,
    workforce: Workforce,
    tried: Collection[Members] = (),
) -> tuple[GroupLook | None, set[Members]]:
    """Align groups as wholes, unless both are of one map, or what was accepted between them contradicts itself.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        How groups are merged and aligned.
    workforce
        Who aligns them.
    tried
        The groups that were before; they are not again.

    Returns
    -------
    The surest join, or None where none was accepted, and the groups that were tried; what is too large to be one map
    is joined with nothing.
    """
    whole = {by_what_they_know(found.maps, group.poses)[0]: group for group in found.groups}
    in_group_of = {name: one for one, group in whole.items() for name in group.poses}
    contradicted = {
        frozenset(in_group_of[name] for name in pair) for pair, one in found.alignments.items() if one.accepted
    }
    pairs = [
        pair
        for pair in itertools.combinations([name for name in found.maps if name in whole], 2)
        if max(len(whole[name]) for name in pair) > 1
        and frozenset(pair) not in contradicted
        and _members(whole, pair) not in tried
    ]
    if not (pairs and config.graph.as_wholes and config.method == "correlation"):
        return None, set()
    wholes = wholes_of(found.maps, {name: whole[name].poses for name in names_in(pairs)}, config, workforce.watch)
    possible = [pair for pair in pairs if all(name in wholes for name in pair)]
    aligned = align_wholes(wholes, possible, config, workforce)
    accepted = {pair: one.T_target_source for pair, one in aligned.items() if one.accepted and one.T_target_source}
    if not accepted:
        return None, {_members(whole, pair) for pair in pairs}
    best = max(accepted, key=lambda pair: aligned[pair].confidence)
    counts = len(whole[best[0]]), len(whole[best[1]])
    T_target, T_source = (wholes[name].poses[name] for name in best)
    alignment = replace(
        aligned[best],
        reason=f"{_so_many(counts[1])} onto {_so_many(counts[0])} merged so far: {aligned[best].reason}",
        T_target_source=T_target.inverse() @ accepted[best] @ T_source,
        covariance=_seen_from(aligned[best].covariance, T_source.inverse()),
        alternatives=(),
    )
    target, source = best
    look = GroupLook(best, alignment, (wholes[target].seen_in(target), wholes[source].seen_in(source)))
    logger.info("%s in %s: %s", *best[::-1], look.alignment.reason)
    # Of the others those that were accepted get their turn, where they are groups still.
    return look, {_members(whole, pair) for pair in pairs if pair == best or pair not in accepted}


def _members(whole: Mapping[str, Group], pair: Pair) -> Members:
    return frozenset(frozenset(whole[name].poses) for name in pair)


def _seen_from(covariance: Covariance | None, T_first_merged: SE2) -> Covariance | None:
    return None if covariance is None else seen_from(covariance, T_first_merged)


def _so_many(count: int) -> str:
    return "one map" if count == 1 else f"{count} maps"
