"""Many maps whose relative poses nobody knows become one."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

from merging.alignment import Alignment
from merging.all_pairs import align_all
from merging.bent_maps import place_bent_map
from merging.config import MergeConfig
from merging.fusion import Fusion
from merging.joint_refinement import JointRefinement
from merging.map_graph import Group, Pair, groups_of
from merging.merged_group import merge_group
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Merge:
    """What became of some maps.

    Parameters
    ----------
    merged
        The merged map, in the frame of the first map that went into it; None where no two maps could be aligned.
    poses
        T_merged_map of every map that went into it.
    alignments
        What was found for every pair (target, source), refusals with their reasons among them.
    left_out
        The maps that did not go into it, and why.
    fusion
        The merged cells with their conflict; None where there is no merged map.
    joint
        What straightening the drives together did; None where the alignment stayed rigid.
    used, outvoted
        The pairs whose alignments agree with the poses, and those that were accepted and do not.
    """

    merged: TbmMap | None
    poses: Mapping[str, SE2]
    alignments: Mapping[Pair, Alignment]
    left_out: Mapping[str, str]
    fusion: Fusion | None
    joint: JointRefinement | None = None
    used: tuple[Pair, ...] = ()
    outvoted: tuple[Pair, ...] = ()


def merge(
    maps: Mapping[str, TbmMap],
    config: MergeConfig | None = None,
    workers: int = 1,
    watch: Watch | None = None,
    scheduler: str | None = None,
) -> Merge:
    """Merge maps whose relative poses nobody knows.

    Every pair of maps is aligned, accepted alignments connect maps to groups, and the largest group is fused in the
    order of the maps. Maps that fit nowhere as a whole are tried once more in stretches of their drives.

    Parameters
    ----------
    maps
        Two maps or more, by name; their order decides whose frame the merged map has.
    config
        How; the defaults where None.
    workers
        Processes that align pairs; the result does not depend on it.
    watch
        Who is told how long the steps take and how far they are.
    scheduler
        Address of a Dask scheduler whose workers align the pairs; the result does not depend on it either.

    Raises
    ------
    ValueError
        If there are fewer than two maps.
    """
    config, watch = config or MergeConfig(), watch or Watch()
    if len(maps) < 2:
        raise ValueError(f"maps must be two or more, got {len(maps)}")
    alignments = align_all(maps, config, workers, watch, scheduler)
    while True:
        with watch.during("grouping"):
            groups = groups_of(list(maps), alignments, config.graph)
        joined = merge_group(maps, groups[0], config, watch) if len(groups[0]) > 1 else None
        bent = place_bent_map(maps, groups, joined, config, workers, watch, scheduler)
        if bent is None:
            break
        (base, name), found = bent
        maps = {**maps, name: found.straightened}
        alignments |= _in_order(list(maps), base, name, found.alignment)
    if joined is None:
        return Merge(None, {}, alignments, dict.fromkeys(maps, "no other map could be aligned with it"), None)
    group = groups[0]
    left_out = {name: _why_left_out(name, group, alignments) for name in maps if name not in group.poses}
    return Merge(
        joined.merged, joined.poses, alignments, left_out, joined.fusion, joined.joint, group.used, group.outvoted
    )


def _in_order(names: list[str], target: str, source: str, found: Alignment) -> dict[Pair, Alignment]:
    """Return an alignment by its pair, of which the map named first is the target."""
    if names.index(target) < names.index(source) or found.T_target_source is None:
        return {(target, source): found}
    return {(source, target): replace(found, T_target_source=found.T_target_source.inverse())}


def _why_left_out(name: str, group: Group, alignments: Mapping[Pair, Alignment]) -> str:
    """Tell what spoke against a map's best alignment with the maps that were merged."""
    tried = {
        target if source == name else source: found
        for (target, source), found in alignments.items()
        if (target == name and source in group.poses) or (source == name and target in group.poses)
    }
    nearest = max(tried, key=lambda other: (tried[other].agreed_wall_m, tried[other].inliers))
    return f"no alignment with a merged map was accepted; with {nearest}: {tried[nearest].reason}"
