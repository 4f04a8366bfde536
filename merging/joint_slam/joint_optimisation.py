"""Joint optimisation of the drives of several robots, and rendering of one map from all of their scans.

A distorted map fits no other map exactly at a rigid pose. Where maps carry keyframes, bundles of keyframes of one robot
are registered to submaps of other robots near the rigid alignment, and to its own submaps of earlier visits. Each
registration that fits is a loop closure. One pose graph holds the closures and the measured motions of all drives.
Finally poses and walls are adjusted jointly (`tbmslam.optimisation.bundle_adjustment`).
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from merging.config.groups import JointConfig
from merging.joint_slam.inter_robot_closures import Track, find_closures
from tbmslam.belief.grid import TbmGrid
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2, FloatArray, compose, inverse
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.local_frame import LocalFrame
from tbmslam.map.rendering import MapConfig, render
from tbmslam.map.tbm_map import TbmMap
from tbmslam.map.trajectory_correction import with_keyframes_at
from tbmslam.optimisation.bundle_adjustment import adjust
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.parallel.progress import Progress


def redraw(drives: Sequence[Keyframes], tbm_map: TbmMap, max_range: float = math.inf) -> TbmGrid:
    """Render the grid of some keyframes with the parameters and the resolution of a map.

    A beam is cut off at `max_range` [m] or at the limit of the map: it clears the cells up to there.
    """
    config = _map_config(tbm_map)
    insertion = config.insertion.model_copy(update={"max_range": min(max_range, config.insertion.max_range)})
    changes = {"resolution": tbm_map.grid.geometry.resolution, "insertion": insertion}
    return render(drives, config.model_copy(update=changes))


def rendered_alike(maps: Sequence[TbmMap]) -> bool:
    """Return whether maps were rendered with the same parameters and resolution."""
    settings = [(_map_config(tbm_map), tbm_map.grid.geometry.resolution) for tbm_map in maps]
    return all(other == settings[0] for other in settings)


def _map_config(tbm_map: TbmMap) -> MapConfig:
    """Return the parameters by which a map was rendered, or the defaults if its provenance has none."""
    settings = tbm_map.provenance.get("config")
    try:
        return MapConfig.model_validate(settings["map"] if isinstance(settings, Mapping) else {})
    except (KeyError, ValidationError):
        return MapConfig()


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class JointRefinement:
    """The result of the joint optimisation.

    Parameters
    ----------
    maps
        Every map with corrected drives and a rendered grid, in the common frame.
    poses
        The rigid T_merged_map of every map that is nearest to the motion of its keyframes.
    closures
        The number of loop closures between different robots.
    links
        These closures (C, 4): a drive of the merged map and its keyframe, and another robot's drive and keyframe.
    moved_m
        RMS distance between the keyframes and their poses by the rigid alignment [m].
    """

    maps: Mapping[str, TbmMap]
    poses: Mapping[str, SE2]
    closures: int
    links: npt.NDArray[np.int64]
    moved_m: float


def refine_jointly(
    maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: JointConfig, progress: Progress | None = None
) -> JointRefinement | None:
    """Optimise the drives of aligned maps jointly.

    Parameters
    ----------
    maps
        The maps, by name.
    poses
        T_merged_map of the merged maps. The first keyframe of the first map is fixed.
    config
        The parameters.
    progress
        Receives the progress.

    Returns
    -------
    None if a map has no keyframes, or if too few loop closures between the robots were found.
    """
    drives = [(name, drive) for name in poses for drive in maps[name].drives]
    if {name for name, _ in drives} != set(poses) or any(len(drive.keyframes) < 2 for _, drive in drives):
        return None
    # The origin of the first map's frame must not influence the result.
    frame = LocalFrame.around(poses[drives[0][0]] @ drives[0][1].keyframes.pose(0))
    poses = {name: frame.T_far_near.inverse() @ pose for name, pose in poses.items()}
    tracks = [Track(name, drive, poses[name], config.submap) for name, drive in drives]
    starts = np.concatenate(([0], np.cumsum([len(track.keyframes) for track in tracks])))
    rigid = np.vstack([track.sensors for track in tracks])
    chain = [edge for track, start in zip(tracks, starts, strict=False) for edge in track.chain(int(start), config)]
    owners = [track.map_name for track in tracks for _ in range(len(track.sensors))]
    moved, closures = rigid, list[MotionEdge]()
    for shift in (config.first_shift_m, config.last_shift_m, *[0.0] * config.tightenings):
        found = find_closures(tracks, starts, moved, shift, config, progress or Progress())
        closures = [edge for edge in found if owners[edge.source] != owners[edge.target]]
        if len(closures) < config.min_closures or not _reach_all(owners, closures):
            logger.info("%d closures between robots are too few: the alignment stays rigid", len(closures))
            return None
        moved = optimise(moved, chain, found, config.robust_width)
    if config.adjustment.enabled:
        scans = [track.hits.scans for track in tracks]
        moved = adjust(moved, scans, chain, found, config.robust_width, config.adjustment)
    corrected = {
        name: frame.map_there(_corrected(name, maps[name], tracks, starts, moved, pose)) for name, pose in poses.items()
    }
    rigid_poses = {name: nearest_rigid(maps[name], corrected[name]) for name in poses}
    moved_m = float(np.sqrt(((moved - rigid)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("%d closures between robots moved keyframes by %.3f m", len(closures), moved_m)
    return JointRefinement(corrected, rigid_poses, len(closures), _links(closures, starts), moved_m)


def _links(closures: list[MotionEdge], starts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the drives and keyframes of closures (C, 4)."""
    ends = np.array([(edge.source, edge.target) for edge in closures], dtype=np.int64).reshape(-1, 2)
    drives = np.searchsorted(starts, ends, side="right") - 1
    return np.stack((drives, ends - starts[drives]), axis=-1).reshape(-1, 4)


def nearest_rigid(before: TbmMap, after: TbmMap) -> SE2:
    """Return the rigid transform nearest to the motion of the keyframes."""
    old, new = (np.vstack([drive.keyframes.poses[:, :2] for drive in tbm_map.drives]) for tbm_map in (before, after))
    return fit_rigid(new, old)[0]


def _reach_all(owners: list[str], closures: list[MotionEdge]) -> bool:
    """Return whether closures connect all maps with keyframes."""
    group = {name: name for name in owners}
    for edge in closures:
        joined, absorbed = group[owners[edge.source]], group[owners[edge.target]]
        group = {name: joined if there == absorbed else there for name, there in group.items()}
    return len(set(group.values())) == 1


def _corrected(
    name: str, tbm_map: TbmMap, tracks: list[Track], starts: npt.NDArray[np.int64], poses: FloatArray, T_merged_map: SE2
) -> TbmMap:
    """Return a map with its corrected drives and a newly rendered grid."""
    drives = []
    for track, start in zip(tracks, starts, strict=False):
        if track.map_name == name:
            sensors = poses[int(start) : int(start) + len(track.sensors)]
            robots = compose(sensors, inverse(track.keyframes.sensor_poses))
            drives.append(with_keyframes_at(track.drive.transformed(T_merged_map), robots))
    grid = redraw([drive.keyframes for drive in drives], tbm_map)
    return TbmMap(grid, tuple(drives), tbm_map.provenance)
