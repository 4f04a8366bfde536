"""Many maps whose relative poses nobody knows become one."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

from merging.alignment import Alignment
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.fusion import Fusion, fuse
from merging.joint_refinement import JointRefinement, refine_jointly
from merging.map_graph import Group, Pair, groups_of
from merging.warping import warp
from tbmslam.grid import GridGeometry, TbmGrid
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
    order of the maps.

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
    with watch.during("grouping"):
        group = groups_of(list(maps), alignments, config.graph)[0]
    left_out = {name: _why_left_out(name, group, alignments) for name in maps if name not in group.poses}
    if len(group) < 2:
        return Merge(None, {}, alignments, dict.fromkeys(maps, "no other map could be aligned with it"), None)
    with watch.during("straightening"):
        joint = refine_jointly(maps, group.poses, config.joint, watch) if config.joint.enabled else None
    poses = group.poses if joint is None else joint.poses
    laid = {name: maps[name].grid if joint is None else joint.maps[name].grid for name in poses}
    placed = {name: pose if joint is None else SE2.identity() for name, pose in poses.items()}
    with watch.during("fusing"):
        fusion = _fused(laid, placed, maps[group.first].grid.geometry, config)
    merged = _merged(maps, poses, joint, fusion, config)
    return Merge(merged, poses, alignments, left_out, fusion, joint, group.used, group.outvoted)


def _fused(
    grids: Mapping[str, TbmGrid], poses: Mapping[str, SE2], lattice: GridGeometry, config: MergeConfig
) -> Fusion:
    if config.merged_resolution is not None:
        lattice = lattice._replace(resolution=config.merged_resolution)
    layers = [warp(grids[name], T_merged_map, lattice) for name, T_merged_map in poses.items()]
    trusts = [config.reliability.get(name, 1.0) for name in poses]
    return fuse(layers, config.rule, config.coverage, trusts)


def _merged(
    maps: Mapping[str, TbmMap],
    poses: Mapping[str, SE2],
    joint: JointRefinement | None,
    fusion: Fusion,
    config: MergeConfig,
) -> TbmMap:
    """Return the fused grid with everybody's drives and where they came from."""
    moved = {
        name: maps[name].moved(pose, fusion.grid) if joint is None else joint.maps[name] for name, pose in poses.items()
    }
    names = [drive.name for one in moved.values() for drive in one.drives]
    drives = tuple(
        replace(drive, name=drive.name if names.count(drive.name) == 1 else f"{name}/{drive.name}")
        for name, one in moved.items()
        for drive in one.drives
    )
    provenance = {
        "merged_from": {
            name: {"pose": list(pose), "provenance": dict(maps[name].provenance)} for name, pose in poses.items()
        },
        "config": config.model_dump(mode="json"),
    }
    return TbmMap(fusion.grid, drives, provenance)


def _why_left_out(name: str, group: Group, alignments: Mapping[Pair, Alignment]) -> str:
    """Tell what spoke against a map's best alignment with the maps that were merged."""
    tried = {
        target if source == name else source: found
        for (target, source), found in alignments.items()
        if (target == name and source in group.poses) or (source == name and target in group.poses)
    }
    nearest = max(tried, key=lambda other: (tried[other].agreed_wall_m, tried[other].inliers))
    return f"no alignment with a merged map was accepted; with {nearest}: {tried[nearest].reason}"
