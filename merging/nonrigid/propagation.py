"""Propagation of pairwise deformations through a group of maps.

The set of maps with known poses, or else the largest set of maps that fit each other rigidly, is not deformed. The
other maps are deformed onto it one after another. A map that was registered to a deformed map takes over its
deformation too. If a map of a rigid set is deformed, the maps of that set without a registration of their own are
deformed with it.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from merging.alignment import Pair
from merging.map_graph.grouping import Group
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.search import NonrigidRegistration
from tbmslam.geometry.se2 import SE2
from tbmslam.map.drive import with_keyframes_at
from tbmslam.map.tbm_map import TbmMap


def deformed_maps(
    registrations: Mapping[Pair, NonrigidRegistration],
    maps: Mapping[str, TbmMap],
    groups: Sequence[Group],
    before: Sequence[Group],
) -> dict[str, TbmMap]:
    """Return the deformed maps by name, each in its own frame.

    `groups` are the groups that the registrations join, and `before` the groups without these registrations: the group
    of known poses first, then the largest first. Of single maps, one with keyframes stays undeformed, since drives can
    be optimised jointly; else the earliest map.
    """
    return {
        name: _deformed(maps[name], deformation)
        for group in groups
        for name, deformation in _deformations(group, registrations, _rigid_sets(group, maps, before))
        if deformation is not None
    }


def _rigid_sets(group: Group, maps: Mapping[str, TbmMap], before: Sequence[Group]) -> list[list[str]]:
    """Return the maps of a group in the sets that were joined rigidly; the first set is not deformed."""
    sets = [names for rigid in before if (names := [name for name in rigid.poses if name in group.poses])]
    return sorted(sets, key=lambda names: (len(names) == 1, len(names) == 1 and not maps[names[0]].drives))


def _deformations(
    group: Group, registrations: Mapping[Pair, NonrigidRegistration], rigid_sets: Sequence[Sequence[str]]
) -> Iterator[tuple[str, Deformation | None]]:
    """Yield the deformation of each map of a group in its own frame; None for a map that is not deformed."""
    mates = {name: names for names in rigid_sets for name in names}
    used = [pair for pair in group.used if pair in registrations]
    done, waiting = dict[str, Deformation | None](), dict.fromkeys(mates)
    while waiting:
        first = next(iter(waiting))
        undeformed = dict.fromkeys(mates[first])
        reached = next(itertools.chain(_by_registration(done, used, registrations), _by_set(done, mates, group)), None)
        for name, deformation in undeformed.items() if reached is None else [reached]:
            done[name] = deformation
            del waiting[name]
            yield name, deformation


def _by_registration(
    done: Mapping[str, Deformation | None], used: Sequence[Pair], registrations: Mapping[Pair, NonrigidRegistration]
) -> Iterator[tuple[str, Deformation]]:
    """Yield the maps that were registered to a map that is done, with their deformations."""
    for anchor, of_anchor in done.items():
        for target, source in used:
            found, name = registrations[target, source], source if anchor == target else target
            if anchor not in (target, source) or name in done:
                continue
            motion, deformation = found.alignment.T_target_source or SE2.identity(), found.deformation
            if name == target:
                motion, deformation = motion.inverse(), deformation.inverse()
            whole = deformation if of_anchor is None else deformation.then(of_anchor)
            yield name, whole.in_frames(motion, SE2.identity())


def _by_set(
    done: Mapping[str, Deformation | None], mates: Mapping[str, Sequence[str]], group: Group
) -> Iterator[tuple[str, Deformation]]:
    """Yield the maps of the rigid set of a deformed map, with its deformation in their frames."""
    for anchor, deformation in done.items():
        for name in mates[anchor]:
            if deformation is not None and name not in done:
                T_anchor_name = group.poses[anchor].inverse() @ group.poses[name]
                yield name, deformation.in_frames(T_anchor_name, T_anchor_name)


def _deformed(source: TbmMap, deformation: Deformation) -> TbmMap:
    """Deform the cells and the drives of a map; a merged map may hold cells that its keyframes did not see."""
    grid = deformation.deformed(source.grid, SE2.identity())
    drives = []
    for drive in source.drives:
        poses = [deformation.motion_at(pose[:2]) @ SE2.from_array(pose) for pose in drive.keyframes.poses]
        drives.append(with_keyframes_at(drive, np.array(poses).reshape(-1, 3)))
    return replace(source, grid=grid, drives=tuple(drives))
