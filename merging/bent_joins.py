"""Maps that no alignment joined: each two get another look, one of them bent, and it stays so in the merged map."""

import itertools
import logging
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from merging.alignment import Alignment, Pair
from merging.bend import Bend
from merging.bent_look import BentLook, look_bent
from merging.config import MergeConfig
from merging.map_graph import Group
from merging.redrawing import redraw
from tbmslam.drive_correction import with_keyframes_at
from tbmslam.se2 import SE2
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.watch import Watch
from tbmslam.worker_pool import worker_pool

logger = logging.getLogger(__name__)


def look_closer(
    maps: Mapping[str, TbmMap],
    groups: Sequence[Group],
    alignments: Mapping[Pair, Alignment],
    config: MergeConfig,
    workers: int = 1,
    watch: Watch | None = None,
) -> dict[Pair, BentLook]:
    """Look at refused pairs of different groups, one of each two maps bent; return those that were aligned so.

    Parameters
    ----------
    maps
        All maps, by name.
    groups
        What was joined so far.
    alignments
        What was found so far.
    config
        How maps are bent and believed.
    workers
        Processes to share the work; every number finds the same.
    watch
        Who is told how far it is.
    """
    where = {name: number for number, group in enumerate(groups) for name in group.poses}
    pairs = [pair for pair, found in alignments.items() if where[pair[0]] != where[pair[1]] and not found.accepted]
    grids = {name: TbmMap(one.grid) for name, one in maps.items()}
    workers, watch = min(workers, len(pairs)), watch or Watch()
    if not (pairs and config.bent.enabled and config.method == "correlation"):
        return {}
    if workers <= 1:
        looks = [_look(pair, grids, config) for pair in watch.each(pairs, "bending", len(pairs), "pairs")]
    else:
        with worker_pool(workers, partial(_hire, grids, config)) as pool:
            looks = list(watch.each(pool.map(_look_here, pairs), "bending", len(pairs), "pairs"))
    return {pair: look for pair, look in zip(pairs, looks, strict=True) if look is not None}


_here: list[tuple[Mapping[str, TbmMap], MergeConfig]] = []
"""The maps, where this process is a worker, and how it bends them."""


def _hire(grids: Mapping[str, TbmMap], config: MergeConfig) -> None:
    _here[:] = [(grids, config)]


def _look_here(pair: Pair) -> BentLook | None:
    return _look(pair, *_here[0])


def _look(pair: Pair, grids: Mapping[str, TbmMap], config: MergeConfig) -> BentLook | None:
    found = look_bent(grids[pair[0]], grids[pair[1]], config)
    if found is not None:
        logger.info("%s in %s: accepted: %s", pair[1], pair[0], found.alignment.reason)
    return found


def straightened_by(
    looks: Mapping[Pair, BentLook], maps: Mapping[str, TbmMap], groups: Sequence[Group]
) -> dict[Pair, tuple[str, TbmMap]]:
    """Return for each pair that counts in a group which of its maps is to be bent, and it, bent, in its own frame.

    It is the source, but for one that carries keyframes where the target does not: drives tell how they bent. A map is
    bent once.
    """
    bent = dict[str, Pair]()
    for pair in dict.fromkeys(itertools.chain.from_iterable(group.used for group in groups)):
        if pair in looks:
            rigid = [name for name in reversed(pair) if not maps[name].drives]
            bent.setdefault((rigid or [pair[1]])[0], pair)
    return {
        pair: (name, _straightened(maps[name], looks[pair], is_source=name == pair[1])) for name, pair in bent.items()
    }


def _straightened(one: TbmMap, look: BentLook, *, is_source: bool) -> TbmMap:
    motion = look.alignment.T_target_source or SE2.identity()
    bend, motion = (look.bend, motion) if is_source else (look.bend.inverse(), motion.inverse())
    drives = tuple(_bent(drive, bend, motion.inverse()) for drive in one.drives)
    grid = redraw([drive.keyframes for drive in drives], one) if drives else bend.straightened(one.grid, motion)
    return TbmMap(grid, drives, one.provenance)


def _bent(drive: Drive, bend: Bend, T_source_target: SE2) -> Drive:
    """Return a drive with each keyframe where the bent map has it."""
    poses = [T_source_target @ bend.motion_at(pose[:2]) @ SE2.from_array(pose) for pose in drive.keyframes.poses]
    return with_keyframes_at(drive, np.array(poses).reshape(-1, 3))
