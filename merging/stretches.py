"""The drives of a map in stretches, and where most of these say that the map lies.

A map that bent while it was made fits another nowhere as a whole, and yet each stretch of it does. A stretch alone may
look like many places; but what is right is said by several of them, while chance says another thing each time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment
from merging.bending_config import StretchConfig
from merging.config import GraphConfig
from merging.offers import Offer, offers_of, worth_of
from merging.redrawing import redraw
from tbmslam.drive_correction import spread_corrections, with_keyframes_at
from tbmslam.evaluation.rigid_fit import fit_rigid
from tbmslam.se2 import SE2, FloatArray, way_lengths, wrap_angle
from tbmslam.tbm_map import TbmMap


@dataclass(frozen=True)
class Stretch:
    """A part of a map that one stretch of a drive saw.

    Parameters
    ----------
    map
        It, in the frame of the whole map.
    points
        Where its keyframes were taken (K, 2) [m].
    drive, keyframe
        Which drive it is of, and its middle keyframe.
    way_m
        Travelled length up to its middle, all drives one after the other [m].
    """

    map: TbmMap
    points: FloatArray
    drive: int
    keyframe: int
    way_m: float


@dataclass(frozen=True)
class Election:
    """The place that stretches agree on.

    Parameters
    ----------
    motion
        T_target_source that fits all of them best.
    motions
        What each of the agreeing stretches says, by its number.
    """

    motion: SE2
    motions: Mapping[int, SE2]


def stretches_of(one: TbmMap, config: StretchConfig) -> list[Stretch]:
    """Cut the drives of a map into stretches of about the same length; a shorter drive is one."""
    ways = [way_lengths(drive.keyframes.poses) for drive in one.drives]
    length = max(config.length_m, sum(float(way[-1]) for way in ways) / config.most)
    stretches, before = list[Stretch](), 0.0
    for number, (drive, travelled) in enumerate(zip(one.drives, ways, strict=True)):
        count = max(round(travelled[-1] / length), 1)
        cuts = np.searchsorted(travelled, travelled[-1] * np.arange(1, count) / count)
        for first, last in zip((0, *cuts.tolist()), (*cuts.tolist(), len(travelled)), strict=True):
            seen = drive.keyframes.part(first, last)
            middle = before + float(travelled[first] + travelled[last - 1]) / 2.0
            where = number, (first + last - 1) // 2
            stretches.append(Stretch(TbmMap(redraw([seen], one)), seen.poses[:, :2], *where, middle))
        before += float(travelled[-1])
    return stretches


def elect(
    stretches: Sequence[Stretch], found: Sequence[Alignment], graph: GraphConfig, config: StretchConfig
) -> Election | None:
    """Return the place that most speaks for, if it is enough.

    Two stretches at least must agree on it, one of them accepted; or more, none of which is, as long as no other place
    has nearly as much for it: where a building repeats itself, doubtful stretches agree on several.

    Parameters
    ----------
    stretches
        Of the source.
    found
        The alignment of each with the target.
    graph
        How much must speak for a place, as between maps.
    config
        How far stretches may differ, what each that agrees is worth, and how many doubtful ones are enough.

    Returns
    -------
    None where there is no such place.
    """
    offers = [offers_of(("target", str(index)), one, graph) for index, one in enumerate(found)]
    places = [
        _Place(_support(offer, agreeing, offers, config), index, offer, agreeing)
        for index, own in enumerate(offers)
        for offer in own
        for agreeing in [_agreeing(stretches, index, offer, offers, config, graph)]
    ]
    best = _best(places, stretches, config, graph)
    if best is None:
        return None
    before = np.vstack([stretches[index].points for index in best.agreeing])
    after = np.vstack([one.motion.apply(stretches[index].points) for index, one in best.agreeing.items()])
    return Election(fit_rigid(after, before)[0], {index: one.motion for index, one in sorted(best.agreeing.items())})


def laid_in_stretches(one: TbmMap, stretches: Sequence[Stretch], place: Election) -> TbmMap:
    """Return a map bent as its stretches were laid, in the target's frame and rendered anew."""
    drives = []
    for number, drive in enumerate(one.drives):
        poses = drive.transformed(place.motion).keyframes.poses
        told = {
            stretches[index].keyframe: motion
            for index, motion in place.motions.items()
            if stretches[index].drive == number
        }
        anchors = np.array(sorted(told), dtype=np.int64)
        laid = np.array([told[anchor] @ drive.keyframes.pose(anchor) for anchor in anchors.tolist()]).reshape(-1, 3)
        drives.append(with_keyframes_at(drive.transformed(place.motion), spread_corrections(poses, anchors, laid)))
    return TbmMap(redraw([drive.keyframes for drive in drives], one), tuple(drives), one.provenance)


@dataclass(frozen=True)
class _Place:
    """A place that a stretch offers: how much speaks for it, and what each of those that agree says."""

    support: float
    index: int
    offer: Offer
    agreeing: Mapping[int, Offer]


def _best(
    places: Sequence[_Place], stretches: Sequence[Stretch], config: StretchConfig, graph: GraphConfig
) -> _Place | None:
    enough = [place for place in places if place.support >= graph.min_support]
    sure = [place for place in enough if place.offer.accepted and len(place.agreeing) > 1]
    if sure:
        return max(sure, key=lambda place: place.support)
    doubtful = [place for place in enough if len(place.agreeing) >= config.doubtful]
    if not doubtful:
        return None
    best = max(doubtful, key=lambda place: place.support)
    elsewhere = [
        place.support
        for place in places
        if not _agree(stretches, (best.index, place.index), (best.offer.motion, place.offer.motion), config, graph)
    ]
    return best if best.support - max(elsewhere, default=0.0) >= graph.min_support else None


def _agreeing(
    stretches: Sequence[Stretch],
    index: int,
    offer: Offer,
    offers: Sequence[Sequence[Offer]],
    config: StretchConfig,
    graph: GraphConfig,
) -> dict[int, Offer]:
    """Return what each stretch says that agrees with the offer of one."""
    agreeing = {index: offer}
    for other, theirs in enumerate(offers):
        near = [one for one in theirs if _agree(stretches, (index, other), (offer.motion, one.motion), config, graph)]
        if near and other != index:
            agreeing[other] = max(near, key=lambda one: one.odds)
    return agreeing


def _support(
    offer: Offer, agreeing: Mapping[int, Offer], offers: Sequence[Sequence[Offer]], config: StretchConfig
) -> float:
    """Return the log odds of a place: what leads to it, less what was accepted and leads elsewhere."""
    others = np.array([one.probability for one in agreeing.values() if one is not offer])
    elsewhere = (one for index, own in enumerate(offers) if index not in agreeing for one in own if one.accepted)
    return offer.odds + float(worth_of(others, config.coincidence).sum()) - sum(one.odds for one in elsewhere)


def _agree(
    stretches: Sequence[Stretch],
    pair: tuple[int, int],
    motions: tuple[SE2, SE2],
    config: StretchConfig,
    graph: GraphConfig,
) -> bool:
    """Tell whether two stretches put the map to one place, but for what it may have bent between them."""
    first, second = (stretches[index] for index in pair)
    way = abs(second.way_m - first.way_m)
    middle = (first.points.mean(axis=0) + second.points.mean(axis=0)) / 2.0
    here, there = (motion.apply(middle) for motion in motions)
    turned = abs(wrap_angle(motions[1].theta - motions[0].theta))
    return (
        math.dist(here, there) <= graph.same_m + config.drift * way
        and turned <= graph.same_rad + config.turn_drift * way
    )
