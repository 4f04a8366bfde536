"""Beyond the rigid: all robots' drives straightened together, and one map rendered anew from all of their scans.

A map that bent while it was made fits another nowhere exactly. Where maps carry keyframes, bundles of one robot's
keyframes are laid onto submaps of another's near where the rigid alignment puts them, and onto its own where it came
back; what fits becomes a closure, and one pose graph of all drives, of what they measured of their motions before they
closed loops by themselves, takes the bends out. In the end drives and walls are adjusted to each other
(`tbmslam.optimisation.bundle_adjustment`).
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


def redraw(drives: Sequence[Keyframes], one: TbmMap, max_range: float = math.inf) -> TbmGrid:
    """Return the grid of some keyframes, rendered as a map says that it was, with cells of its size.

    A hit beyond `max_range` [m], or beyond the map's own limit, only clears the way up to it.
    """
    how = _map_config(one)
    insertion = how.insertion.model_copy(update={"max_range": min(max_range, how.insertion.max_range)})
    return render(drives, how.model_copy(update={"resolution": one.grid.geometry.resolution, "insertion": insertion}))


def drawn_alike(maps: Sequence[TbmMap]) -> bool:
    """Tell whether maps say that they were rendered in one way, in cells of one size."""
    ways = [(_map_config(one), one.grid.geometry.resolution) for one in maps]
    return all(way == ways[0] for way in ways)


def _map_config(one: TbmMap) -> MapConfig:
    """Return how a map says that it was rendered; the default where it does not say."""
    settings = one.provenance.get("config")
    try:
        return MapConfig.model_validate(settings["map"] if isinstance(settings, Mapping) else {})
    except (KeyError, ValidationError):
        return MapConfig()


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class JointRefinement:
    """Maps after their drives were straightened together.

    Parameters
    ----------
    maps
        Every map with its drives corrected and its grid rendered anew, in the common frame.
    poses
        The rigid T_merged_map of every map that comes nearest to what became of its keyframes.
    closures
        How many motions between different robots' keyframes were found.
    links
        The same as (C, 4): a drive of the merged map and a keyframe of it, and another robot's drive and keyframe.
    moved_m
        Root mean square distance by which keyframes moved against the rigid alignment [m].
    """

    maps: Mapping[str, TbmMap]
    poses: Mapping[str, SE2]
    closures: int
    links: npt.NDArray[np.int64]
    moved_m: float


def refine_jointly(
    maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: JointConfig, progress: Progress | None = None
) -> JointRefinement | None:
    """Straighten the drives of aligned maps together.

    Parameters
    ----------
    maps
        The maps, by name.
    poses
        T_merged_map of those that are merged; the first one's first keyframe stays where it is.
    config
        When a bundle fits a submap, and how stiff a drive is.
    progress
        Who is told how far it is.

    Returns
    -------
    None where a map has no keyframes, or too few closures between the robots were found to do better than rigidly.
    """
    drives = [(name, drive) for name in poses for drive in maps[name].drives]
    if {name for name, _ in drives} != set(poses) or any(len(drive.keyframes) < 2 for _, drive in drives):
        return None
    # Where the first map has its frame's origin must not matter.
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
    straight = {name: nearest_rigid(maps[name], corrected[name]) for name in poses}
    moved_m = float(np.sqrt(((moved - rigid)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("%d closures between robots moved keyframes by %.3f m", len(closures), moved_m)
    return JointRefinement(corrected, straight, len(closures), _links(closures, starts), moved_m)


def _links(closures: list[MotionEdge], starts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return closures (C, 4) by the drives and keyframes they are between."""
    ends = np.array([(edge.source, edge.target) for edge in closures], dtype=np.int64).reshape(-1, 2)
    drives = np.searchsorted(starts, ends, side="right") - 1
    return np.stack((drives, ends - starts[drives]), axis=-1).reshape(-1, 4)


def nearest_rigid(before: TbmMap, after: TbmMap) -> SE2:
    """Return the rigid motion nearest to what happened to the keyframes."""
    old, new = (np.vstack([drive.keyframes.poses[:, :2] for drive in one.drives]) for one in (before, after))
    return fit_rigid(new, old)[0]


def _reach_all(owners: list[str], closures: list[MotionEdge]) -> bool:
    """Tell whether closures connect all maps that own keyframes."""
    group = {name: name for name in owners}
    for edge in closures:
        joined, absorbed = group[owners[edge.source]], group[owners[edge.target]]
        group = {name: joined if there == absorbed else there for name, there in group.items()}
    return len(set(group.values())) == 1


def _corrected(
    name: str,
    one: TbmMap,
    tracks: list[Track],
    starts: npt.NDArray[np.int64],
    poses: FloatArray,
    T_merged_map: SE2,
) -> TbmMap:
    """Return a map with its drives as they are now, rendered anew."""
    drives = []
    for track, start in zip(tracks, starts, strict=False):
        if track.map_name == name:
            sensors = poses[int(start) : int(start) + len(track.sensors)]
            robots = compose(sensors, inverse(track.keyframes.sensor_poses))
            drives.append(with_keyframes_at(track.drive.transformed(T_merged_map), robots))
    grid = redraw([drive.keyframes for drive in drives], one)
    return TbmMap(grid, tuple(drives), one.provenance)
