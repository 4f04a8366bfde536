"""Joint optimisation of the drives of several robots, and rendering of one map from all of their scans.

A distorted map fits no other map exactly at a rigid pose. Therefore bundles of keyframes of one robot are registered to
submaps of other robots near the rigid alignment, and to its own submaps of earlier visits. Each good registration is a
loop closure. One pose graph holds the closures and the measured motions of all drives.
Finally poses and walls are adjusted jointly (`tbmslam.optimisation.bundle_adjustment`).
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import ValidationError

from merging.config.groups import JointConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, inverse
from tbmslam.loop_closure.submap import Submap, SubmapConfig, split_into_submaps, without_open_direction
from tbmslam.map.drive import Drive, DriveLinks, DriveMotions, with_keyframes_at
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.local_frame import LocalFrame
from tbmslam.map.rendering import MapConfig, render
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.map.tbm_map import TbmMap
from tbmslam.optimisation.bundle_adjustment import adjust
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge, relative_pose
from tbmslam.parallel.executor import Progress
from tbmslam.tracking.surfel_map import SurfelConfig
from tbmslam.tracking.tracked_keyframe import chain

logger = logging.getLogger(__name__)


class Track:
    """A drive in the merged frame; `sensors` (K, 3) are the poses of the laser, `submaps` the targets of bundles."""

    def __init__(self, map_name: str, drive: Drive, T_merged_map: SE2, config: SubmapConfig) -> None:
        self.map_name, self.drive = map_name, drive
        self.keyframes: Keyframes = drive.keyframes.transformed(T_merged_map)
        self.sensors = self.keyframes.all_sensor_poses()
        self.hits = DriveHits(ScanHits.of(self.keyframes, config.max_range), self.sensors)
        stretches = split_into_submaps(self.hits.travelled, config.length)
        self.submaps = [Submap(first, last, self.hits, config, SurfelConfig()) for first, last in stretches]

    def chain(self, start: int, config: JointConfig) -> list[MotionEdge]:
        """Return the drive's motions as edges; its first keyframe is the pose `start` of the graph.

        If the measured motions were not stored, they are derived from the poses. They have small deviations, and larger
        ones if the drive crosses its path, since loops were closed there.
        """
        if self.drive.motions is not None:
            return chain(self.drive.motions, start)
        pairs = [(index, index + 1, config.step_m, config.step_rad) for index in range(len(self.sensors) - 1)]
        stops = self.hits.stops(config.stiffness_step_m)
        for number, first in enumerate(stops):
            apart = np.hypot(*(self.sensors[stops[number + 2 :], :2] - self.sensors[first, :2]).T)
            near = [stops[number + 2 + int(k)] for k in np.flatnonzero(apart < config.stiffness_reach_m)]
            pairs += [(first, second, config.crossing_m, config.crossing_rad) for second in near]
        return [
            MotionEdge(
                start + first, start + second, relative_pose(self.sensors, first, second),
                np.diag([metres**-2, metres**-2, radians**-2]),
            )
            for first, second, metres, radians in pairs
        ]  # fmt: skip

    def others(self, keyframe: int, other: "Track", config: JointConfig) -> list[int]:
        """Return the submaps of a drive as targets of a keyframe; of its own drive those of earlier visits only."""
        if other is not self:
            return list(range(len(other.submaps)))
        if self.drive.motions is None:  # the edges from the poses already contain its loops
            return []
        travelled = self.hits.travelled
        since = travelled[keyframe] - travelled[[submap.last for submap in self.submaps]]
        return np.flatnonzero(since > config.min_gap_m).tolist()


def find_closures(
    tracks: Sequence[Track],
    starts: IntArray,
    poses: FloatArray,
    shift: float,
    config: JointConfig,
    progress: Progress,
) -> list[MotionEdge]:
    """Register bundles of every drive to the nearest submaps of all drives.

    `poses` (N, 3) are the current poses of the lasers at the keyframes of all drives, and `starts` (D,) the first index
    of each drive. The search covers a distance of `shift` from the current pose [m]; 0 registers without a search.
    """
    found = []
    for moving, track in enumerate(tracks):
        stops = track.hits.stops(config.step)
        for index in progress.shown(stops, f"closing loops of {track.map_name}", len(stops), "places"):
            here = int(starts[moving]) + index
            for fixed, other in enumerate(tracks):
                offset = int(starts[fixed])
                offsets = poses[offset : offset + len(other.sensors), :2] - poses[here, :2]
                distances = np.hypot(offsets[:, 0], offsets[:, 1])
                nearest = sorted(
                    (float(distances[other.submaps[k].first : other.submaps[k].last + 1].min()), k)
                    for k in track.others(index, other, config)
                )
                for distance, number in nearest[: config.submaps_per_step]:
                    if distance <= config.reach_m:
                        edge = _closure(track, index, other.submaps[number], (here, offset), poses, shift, config)
                        found += [] if edge is None else [edge]
    return found


def _closure(
    track: Track,
    index: int,
    submap: Submap,
    places: tuple[int, int],
    poses: FloatArray,
    shift: float,
    config: JointConfig,
) -> MotionEdge | None:
    """Return the loop closure of a bundle and a submap, or None if it does not fit or is ambiguous."""
    here, offset = places
    bundle = track.hits.bundle(index, config.bundle_m, config.match_points)
    if len(bundle.points) < config.search_points // 2:
        return None
    guess = relative_pose(poses, offset + submap.anchor, here)
    if shift > 0.0:
        find = submap.search(bundle.thinned(config.search_points).points, guess, shift, config.turn_rad)
        if find.ambiguity > config.max_ambiguity:
            return None
        guess = find.pose
    fit = submap.fit(bundle, guess)
    is_sure = fit.matched >= config.sure_matched
    if fit.matched < config.min_matched or fit.violated > config.max_violated * fit.matched:
        return None
    if not is_sure and here - index == offset:  # a doubtful loop within a drive: its own SLAM refused it
        return None
    if math.hypot(fit.pose.x - guess.x, fit.pose.y - guess.y) > config.last_shift_m:
        return None
    floor = np.diag([config.closure_m**2, config.closure_m**2, config.closure_rad**2])
    information = np.linalg.inv(
        np.linalg.inv(without_open_direction(fit.hessian, config.min_determined) + np.eye(3) * 1e-3) + floor
    )
    information *= 1.0 if is_sure else config.doubtful_weight
    rotation = SE2(0.0, 0.0, fit.pose.theta).matrix()
    return MotionEdge(offset + submap.anchor, here, fit.pose, np.asarray(rotation.T @ information @ rotation))


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


@dataclass(frozen=True)
class JointRefinement:
    """The result of the joint optimisation."""

    maps: Mapping[str, TbmMap]
    """Every map with corrected drives and a rendered grid, in the common frame."""
    poses: Mapping[str, SE2]
    """The rigid T_merged_map of every map that is nearest to the motion of its keyframes."""
    closures: int
    """The number of loop closures between different robots."""
    links: DriveLinks
    """These closures, by the drives of the merged map."""
    moved_m: float
    """RMS distance between the keyframes and their poses by the rigid alignment [m]."""


def refine_jointly(
    maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: JointConfig, progress: Progress | None = None
) -> JointRefinement | None:
    """Optimise the drives of aligned maps jointly, with the first keyframe of the first map fixed.

    `poses` are T_merged_map of the merged maps. Returns None if a map has no drive or a drive has fewer than two
    keyframes, or if too few loop closures between the robots were found.
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
    steps = [track.chain(int(start), config) for track, start in zip(tracks, starts, strict=False)]
    chain = [edge for own in steps for edge in own]
    owners = [track.map_name for track in tracks for _ in range(len(track.sensors))]
    moved, closures = rigid, list[MotionEdge]()
    for shift in (config.first_shift_m, config.last_shift_m, *[0.0] * config.tightenings):
        found = find_closures(tracks, starts, moved, shift, config, progress or Progress())
        closures = [edge for edge in found if owners[edge.source] != owners[edge.target]]
        if len(closures) < config.min_closures or not _reach_all(owners, closures):
            logger.info("%d closures between robots are too few: the alignment stays rigid", len(closures))
            return None
        moved = optimise(moved, EdgeArrays.of(chain), found, config.robust_width)
    if config.adjustment.enabled:
        scans = [track.hits.scans for track in tracks]
        chains = [MotionChain.of([edge for edge in own if edge.target == edge.source + 1]) for own in steps]
        others = [edge for edge in chain if edge.target != edge.source + 1]
        moved = adjust(moved, scans, chains, found, config.robust_width, config.adjustment, others)
    corrected = {
        name: frame.map_there(_corrected(name, maps[name], tracks, starts, moved, pose)) for name, pose in poses.items()
    }
    rigid_poses = {name: nearest_rigid(maps[name], corrected[name]) for name in poses}
    moved_m = float(np.sqrt(((moved - rigid)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("%d closures between robots moved keyframes by %.3f m", len(closures), moved_m)
    return JointRefinement(corrected, rigid_poses, len(closures), _links(closures, starts), moved_m)


def _links(closures: list[MotionEdge], starts: IntArray) -> DriveLinks:
    """Return closures by the drives and their keyframes."""
    ends, steps, informations = EdgeArrays.of(closures)
    return DriveLinks(_by_drive(ends, starts), DriveMotions(steps, informations))


def _by_drive(ends: IntArray, starts: IntArray) -> IntArray:
    """Return the drives and their keyframes (C, 4) of pairs of poses of the graph (C, 2)."""
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
    name: str, tbm_map: TbmMap, tracks: list[Track], starts: IntArray, poses: FloatArray, T_merged_map: SE2
) -> TbmMap:
    """Return a map with its corrected drives and a newly rendered grid."""
    drives = []
    for track, start in zip(tracks, starts, strict=False):
        if track.map_name == name:
            sensors = poses[int(start) : int(start) + len(track.sensors)]
            robots = compose(sensors, inverse(track.keyframes.sensor_poses))
            drives.append(with_keyframes_at(track.drive.transformed(T_merged_map), robots))
    grid = redraw([drive.keyframes for drive in drives], tbm_map)
    return replace(tbm_map, grid=grid, drives=tuple(drives))
