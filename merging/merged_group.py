"""Maps whose relative poses are known become one: their drives straightened together, their cells fused."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from merging.config import MergeConfig
from merging.fusion.fusion import Fusion, fuse
from merging.fusion.warping import place
from merging.joint_slam.joint_optimisation import JointRefinement, refine_jointly
from merging.joint_slam.rendering import drawn_alike, redraw
from merging.map_graph.grouping import Group
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.progress import Watch


@dataclass(frozen=True)
class MergedGroup:
    """One map of several.

    Parameters
    ----------
    merged
        The map, in the frame of the first that went into it.
    poses
        T_merged_map of every map that went into it.
    fusion
        The merged cells; and their conflict and how many saw them, which the maps' own cells say.
    joint
        What straightening the drives together did; None where the maps stayed as they were.
    """

    merged: TbmMap
    poses: Mapping[str, SE2]
    fusion: Fusion
    joint: JointRefinement | None


def merge_group(maps: Mapping[str, TbmMap], group: Group, config: MergeConfig, watch: Watch) -> MergedGroup:
    """Make one map of a group's maps."""
    with watch.during("straightening"):
        joint = refine_jointly(maps, group.poses, config.joint, watch) if config.joint.enabled else None
    poses = group.poses if joint is None else joint.poses
    laid = {name: maps[name].grid if joint is None else joint.maps[name].grid for name in poses}
    placed = {name: pose if joint is None else SE2.identity() for name, pose in poses.items()}
    with watch.during("fusing"):
        fusion = _fused(laid, placed, maps[group.first].grid.geometry, config)
        if joint is not None and _may_be_drawn(joint, config):
            fusion = replace(fusion, grid=_drawn(joint, fusion.grid.geometry), rule="redrawn")
    return MergedGroup(_merged(maps, poses, joint, fusion, config), poses, fusion, joint)


def _fused(
    grids: Mapping[str, TbmGrid], poses: Mapping[str, SE2], lattice: GridGeometry, config: MergeConfig
) -> Fusion:
    if config.merged_resolution is not None:
        lattice = lattice._replace(resolution=config.merged_resolution)
    layers = [place(grids[name], T_merged_map, lattice) for name, T_merged_map in poses.items()]
    trusts = [config.reliability.get(name, 1.0) for name in poses]
    return fuse(layers, config.rule or "disjunctive", config.coverage, trusts)


def _may_be_drawn(joint: JointRefinement, config: MergeConfig) -> bool:
    """Tell whether all scans may go into one grid: nothing else is asked for, and the maps were rendered alike."""
    asked = config.rule is not None or config.coverage != "union" or any(t < 1.0 for t in config.reliability.values())
    return not asked and drawn_alike(list(joint.maps.values()))


def _drawn(joint: JointRefinement, canvas: GridGeometry) -> TbmGrid:
    """Render the scans of all drives into one grid, as if one robot had taken them."""
    maps = list(joint.maps.values())
    drawn = redraw([drive.keyframes for one in maps for drive in one.drives], maps[0])
    return resample(drawn, SE2.identity(), canvas)


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
            name: {"pose": list(pose), "drives": len(maps[name].drives), "provenance": dict(maps[name].provenance)}
            for name, pose in poses.items()
        },
        "config": config.model_dump(mode="json"),
    }
    return TbmMap(fusion.grid, drives, provenance)
