"""Maps that were joined once one of two was bent: which of them stay as they are, and how the others are bent.

The largest lot of maps that fit each other as they are stays so. The others are bent onto it one after the other; one
that lies on a bent map is bent as that is besides. Of a lot that is bent, maps with no place of their own go along.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from merging.alignment import Pair
from merging.map_graph.grouping import Group
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.search import NonrigidRegistration
from tbmslam.geometry.se2 import SE2
from tbmslam.map.drive import Drive
from tbmslam.map.tbm_map import TbmMap
from tbmslam.map.trajectory_correction import with_keyframes_at


def deformed_maps(
    looks: Mapping[Pair, NonrigidRegistration],
    maps: Mapping[str, TbmMap],
    groups: Sequence[Group],
    before: Sequence[Group],
) -> dict[str, TbmMap]:
    """Return the maps that are to be bent by name, bent, each in its own frame.

    Parameters
    ----------
    looks
        What was found of pairs of which one map is bent.
    maps
        All maps, by name.
    groups
        What these join.
    before
        What was joined without, the known ones before all and then the largest first. Of maps alone those with
        keyframes stay as they are where others have none, since drives tell how they bent; then the one named first.
    """
    return {
        name: _straightened(maps[name], bend)
        for group in groups
        for name, bend in _bends(group, looks, _lots(group, maps, before))
        if bend is not None
    }


def _lots(group: Group, maps: Mapping[str, TbmMap], before: Sequence[Group]) -> list[list[str]]:
    """Return the maps of a group in lots that were joined before; what is first stays as it is."""
    lots = [lot for one in before if (lot := [name for name in one.poses if name in group.poses])]
    return sorted(lots, key=lambda lot: (len(lot) == 1, len(lot) == 1 and not maps[lot[0]].drives))


def _bends(
    group: Group, looks: Mapping[Pair, NonrigidRegistration], lots: Sequence[Sequence[str]]
) -> Iterator[tuple[str, Deformation | None]]:
    """Yield how each map of a group is bent in its own frame; None of one that stays as it is."""
    mates = {name: lot for lot in lots for name in lot}
    used = [pair for pair in group.used if pair in looks]
    laid, waiting = dict[str, Deformation | None](), dict.fromkeys(mates)
    while waiting:
        first = next(iter(waiting))
        some = dict.fromkeys(mates[first])  # stay as they are, unless one of the others can be laid
        more = next(itertools.chain(_onto_laid(laid, used, looks), _along(laid, mates, group)), None)
        for name, bend in some.items() if more is None else [more]:
            laid[name] = bend
            del waiting[name]
            yield name, bend


def _onto_laid(
    laid: Mapping[str, Deformation | None], used: Sequence[Pair], looks: Mapping[Pair, NonrigidRegistration]
) -> Iterator[tuple[str, Deformation]]:
    """Yield the maps that are bent onto those laid already, and how."""
    for there, its in laid.items():
        for target, source in used:
            look, name = looks[target, source], source if there == target else target
            if there not in (target, source) or name in laid:
                continue
            motion = look.alignment.T_target_source or SE2.identity()
            bend, motion = (look.bend, motion) if name == source else (look.bend.inverse(), motion.inverse())
            yield name, (bend if its is None else bend.then(its)).seen_from(motion, SE2.identity())


def _along(
    laid: Mapping[str, Deformation | None], mates: Mapping[str, Sequence[str]], group: Group
) -> Iterator[tuple[str, Deformation]]:
    """Yield the maps that were joined with a bent one before, and how they are bent along."""
    for there, bend in laid.items():
        for name in mates[there]:
            if bend is not None and name not in laid:
                T_there_name = group.poses[there].inverse() @ group.poses[name]
                yield name, bend.seen_from(T_there_name, T_there_name)


def _straightened(one: TbmMap, bend: Deformation) -> TbmMap:
    """Deform a map's cells and its drives: what was merged before holds more than its keyframes saw."""
    grid = bend.straightened(one.grid, SE2.identity())
    return TbmMap(grid, tuple(_bent(drive, bend) for drive in one.drives), one.provenance)


def _bent(drive: Drive, bend: Deformation) -> Drive:
    """Return a drive with each keyframe where the bent map has it."""
    poses = [bend.motion_at(pose[:2]) @ SE2.from_array(pose) for pose in drive.keyframes.poses]
    return with_keyframes_at(drive, np.array(poses).reshape(-1, 3))
