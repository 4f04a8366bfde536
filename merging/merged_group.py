"""Merges the maps of a group, whose relative poses are known: drives are optimised jointly, cells are fused."""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from merging.config import MergeConfig, Rule
from merging.fusion import CellSizeError, Fusion, fuse, place
from merging.joint_slam import JointRefinement, redraw, refine_jointly, rendered_alike
from merging.map_graph.grouping import Group
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import PlacedGrid, corners_of
from tbmslam.geometry.se2 import SE2
from tbmslam.map.drive import DriveLinks
from tbmslam.map.map_check import MAX_CELLS
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class MergedGroup:
    """The merged map of a group."""

    merged: TbmMap
    """The map, in the frame of its first map."""
    poses: Mapping[str, SE2]
    """T_merged_map of every map."""
    fusion: Fusion
    """The merged cells; conflict and counts are those of the maps' own cells."""
    joint: JointRefinement | None
    """The joint optimisation of the drives; None if the maps stayed rigid."""


def merge_group(maps: Mapping[str, TbmMap], group: Group, config: MergeConfig, progress: Progress) -> MergedGroup:
    """Merge the maps of a group."""
    with progress.during("joint optimisation"):
        joint = refine_jointly(maps, group.poses, config.joint, progress) if config.joint.enabled else None
    poses = group.poses if joint is None else joint.poses
    laid = {name: maps[name].grid if joint is None else joint.maps[name].grid for name in poses}
    placed = {name: pose if joint is None else SE2.identity() for name, pose in poses.items()}
    with progress.during("fusing"):
        fusion = _fused(laid, placed, maps[group.first].grid.geometry, config, config.rule or "disjunctive")
        if joint is not None and _may_be_rendered(joint, config):
            fusion = replace(fusion, grid=_drawn(joint, fusion.grid.geometry), rule="redrawn")
    return MergedGroup(_merged(maps, poses, joint, fusion, config), poses, fusion, joint)


def _fused(
    grids: Mapping[str, TbmGrid], poses: Mapping[str, SE2], lattice: GridGeometry, config: MergeConfig, rule: Rule
) -> Fusion:
    if config.merged_resolution is not None:
        lattice = lattice._replace(resolution=config.merged_resolution)
    layers = [place(grids[name], T_merged_map, lattice) for name, T_merged_map in poses.items()]
    trusts = [config.reliability.get(name, 1.0) for name in poses]
    return fuse(layers, rule, config.coverage, trusts)


def _may_be_rendered(joint: JointRefinement, config: MergeConfig) -> bool:
    """Return whether all scans may be rendered into one grid: by default, if the maps were rendered alike."""
    asked = config.rule is not None or config.coverage != "union" or any(t < 1.0 for t in config.reliability.values())
    return not asked and rendered_alike(list(joint.maps.values()))


def _drawn(joint: JointRefinement, canvas: GridGeometry) -> TbmGrid:
    """Return the grid of the scans of all drives, on the cells of a canvas."""
    maps = list(joint.maps.values())
    drawn = redraw([drive.keyframes for tbm_map in maps for drive in tbm_map.drives], maps[0])
    return PlacedGrid(drawn, SE2.identity(), canvas).drawn()


def _merged(
    maps: Mapping[str, TbmMap],
    poses: Mapping[str, SE2],
    joint: JointRefinement | None,
    fusion: Fusion,
    config: MergeConfig,
) -> TbmMap:
    """Return the fused grid with all drives and their provenance."""
    moved = {
        name: maps[name].moved(pose, fusion.grid) if joint is None else joint.maps[name] for name, pose in poses.items()
    }
    names = [drive.name for tbm_map in moved.values() for drive in tbm_map.drives]
    drives = tuple(
        replace(drive, name=drive.name if names.count(drive.name) == 1 else _distinct_name(name, drive.name))
        for name, tbm_map in moved.items()
        for drive in tbm_map.drives
    )
    provenance = {
        "merged_from": {
            name: {"pose": list(pose), "drives": len(maps[name].drives), "provenance": dict(maps[name].provenance)}
            for name, pose in poses.items()
        },
        "config": config.model_dump(mode="json"),
    }
    return TbmMap(fusion.grid, drives, provenance, _links(maps, poses, joint))


def _links(maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], joint: JointRefinement | None) -> DriveLinks | None:
    """Return the loop closures between drives: those of the maps that are merges themselves, and the new ones."""
    parts, first = [] if joint is None else [joint.links], 0
    for name in poses:
        if (links := maps[name].links) is not None:
            parts.append(links.renumbered(first))
        first += len(maps[name].drives)
    return DriveLinks.joined(parts)


def _distinct_name(name: str, drive: str) -> str:
    """Return a drive's name with that of its map, which may hold it: `1/run` and `2/run` are folders of one name."""
    return name if f"/{name}".endswith(f"/{drive}") else f"{name}/{drive}"


_DEFAULT_FUSION: dict[str, object] = {"rule": None, "coverage": "union", "reliability": {}, "merged_resolution": None}


@dataclass(frozen=True)
class GroupMap:
    """A group of maps as one map."""

    grid: TbmGrid
    T_common_map: SE2
    """Pose of the map's frame in the frame in which the poses of the group were given."""


def group_maps_of(
    maps: Mapping[str, TbmMap],
    groups: Sequence[Mapping[str, SE2]],
    config: MergeConfig,
    progress: Progress,
    joint: JointRefinement | None = None,
    max_range: float = math.inf,
) -> list[GroupMap]:
    """Merge groups, given as T_common_map of their maps, to one map each.

    `joint` is a joint optimisation of maps of all groups, see `jointly_refined`. Without it each group is optimised on
    its own. Maps with drives are rendered without hits beyond `max_range` [m]. The rule, the coverage and the
    reliabilities of the user are not applied. Grids are averaged: by the disjunctive rule walls that differ by a cell
    become unknown, and a group of ten maps has hardly any wall. Raises a `CellSizeError` if a group is too large.
    """
    config = config.model_copy(update=_DEFAULT_FUSION)
    for group in groups:
        _check_extent(maps, group, config)
    return [
        _group_map(maps, group, config, joint or jointly_refined(maps, group, config, progress), max_range)
        for group in groups
    ]


def jointly_refined(
    maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: MergeConfig, progress: Progress
) -> JointRefinement | None:
    """Optimise the drives of a group, given as T_common_map, jointly; None with fewer than two drives or closures."""
    ordered = most_known_first(maps, poses)
    driven = {name: poses[name] for name in ordered if maps[name].drives}
    return refine_jointly(maps, driven, config.joint, progress) if len(driven) > 1 else None


def _group_map(
    maps: Mapping[str, TbmMap],
    poses: Mapping[str, SE2],
    config: MergeConfig,
    joint: JointRefinement | None,
    max_range: float,
) -> GroupMap:
    """Merge a group in the frame of its best known map, or in the common frame if this map was optimised jointly."""
    first = most_known_first(maps, poses)[0]
    refined = {} if joint is None else {name: joint.maps[name] for name in poses if name in joint.maps}
    T_common_first = SE2.identity() if first in refined else poses[first]
    T_first = T_common_first.inverse()
    laid = {name: grid_within(refined.get(name, maps[name]), max_range) for name in poses}
    if len(laid) == 1:
        return GroupMap(laid[first], T_common_first)
    placed = {name: T_first if name in refined else T_first @ pose for name, pose in poses.items()}
    return GroupMap(_fused(laid, placed, laid[first].geometry, config, "average").grid, T_common_first)


def grid_within(tbm_map: TbmMap, max_range: float) -> TbmGrid:
    """Return the grid of a map, without hits beyond a range if it has drives."""
    if math.isinf(max_range) or not tbm_map.drives:
        return tbm_map.grid
    return redraw([drive.keyframes for drive in tbm_map.drives], tbm_map, max_range)


def most_known_first(maps: Mapping[str, TbmMap], names: Iterable[str]) -> list[str]:
    """Return the names of maps, the largest known area first, so that their order does not matter."""
    names = list(names)
    if len(names) == 1:
        return names
    return sorted(names, key=lambda name: -maps[name].grid.known_m2())


def _check_extent(maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: MergeConfig) -> None:
    """Refuse maps that would have too many cells together, before memory is allocated."""
    if len(poses) < 2:
        return
    first = most_known_first(maps, poses)[0]
    cell_m = maps[first].grid.geometry.resolution
    cell_m = min(cell_m, config.resolution or cell_m)
    T_first = poses[first].inverse()
    corners = [corners_of(maps[name].grid.known_part().geometry, T_first @ pose) for name, pose in poses.items()]
    width, height = np.ptp(np.concatenate(corners), axis=0)
    cells = width * height / cell_m**2
    if not cells <= MAX_CELLS:
        raise CellSizeError(
            f"{width:.0f} x {height:.0f} m in cells of {cell_m:g} m would be {cells:.2g} cells, more than the "
            f"{MAX_CELLS:.0e} that are possible"
        )
