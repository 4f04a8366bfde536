"""Beyond the rigid: all robots' drives straightened together, and one map rendered anew from all of their scans.

A map that bent while it was made fits another nowhere exactly. Where maps carry keyframes, bundles of one robot's
keyframes are laid onto submaps of another's near where the rigid alignment puts them; what fits becomes a closure
between the robots, and one pose graph of all drives takes the bends out.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.config import JointConfig
from merging.consensus import fit_rigid
from merging.redrawing import redraw
from tbmslam.drive_correction import with_keyframes_at
from tbmslam.drive_hits import DriveHits
from tbmslam.keyframes import Keyframes
from tbmslam.pose_graph import MotionEdge, optimise, relative_pose
from tbmslam.se2 import SE2, FloatArray, compose, inverse
from tbmslam.submap import Submap, SubmapConfig, split_into_submaps
from tbmslam.surfel_map import SurfelConfig
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.watch import Watch

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
    maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: JointConfig, watch: Watch | None = None
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
    watch
        Who is told how far it is.

    Returns
    -------
    None where a map has no keyframes, or too few closures between the robots were found to do better than rigidly.
    """
    reach = config.submap.max_range
    drives = [(name, drive) for name in poses for drive in maps[name].drives]
    if {name for name, _ in drives} != set(poses) or any(len(drive.keyframes) < 2 for _, drive in drives):
        return None
    tracks = [_Track(name, drive, poses[name], reach) for name, drive in drives]
    starts = np.concatenate(([0], np.cumsum([len(track.keyframes) for track in tracks])))
    rigid = np.vstack([track.sensors for track in tracks])
    chain = [edge for track, start in zip(tracks, starts, strict=False) for edge in track.chain(int(start), config)]
    submaps = [track.submaps(config.submap) for track in tracks]
    moved, closures = rigid, list[MotionEdge]()
    for shift in (config.first_shift_m, config.last_shift_m):
        closures = _closures(tracks, submaps, starts, moved, shift, config, watch or Watch())
        if len(closures) < config.min_closures or not _reach_all(tracks, closures):
            logger.info("%d closures between robots are too few: the alignment stays rigid", len(closures))
            return None
        moved = optimise(moved, chain, closures, config.robust_width)
    corrected = {name: _corrected(name, maps[name], tracks, starts, moved, poses[name]) for name in poses}
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


class _Track:
    """One robot's laser along its drive, in the merged frame."""

    def __init__(self, map_name: str, drive: Drive, T_merged_map: SE2, max_range: float) -> None:
        self.map_name, self.drive = map_name, drive
        self.keyframes: Keyframes = drive.keyframes.transformed(T_merged_map)
        self.sensors = self.keyframes.all_sensor_poses()
        self.hits = DriveHits(self.keyframes, self.sensors, max_range)

    def chain(self, start: int, config: JointConfig) -> list[MotionEdge]:
        """Return the drive's own motions: stiff from keyframe to keyframe, and less so where it crosses its way."""
        count = len(self.sensors)
        pairs = [(index, index + 1, config.step_m, config.step_rad) for index in range(count - 1)]
        stops = self.stops(config.stiffness_step_m)
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

    def stops(self, step: float) -> list[int]:
        """Return keyframes at least about `step` metres apart."""
        _, first = np.unique((self.hits.travelled / step).astype(np.int64), return_index=True)
        return [int(index) for index in first]

    def submaps(self, config: SubmapConfig) -> list[Submap]:
        """Return stretches of the drive as submaps."""
        stretches = split_into_submaps(self.sensors, config.length)
        return [Submap(first, last, self.hits, config, SurfelConfig()) for first, last in stretches]


def _closures(
    tracks: list[_Track],
    submaps: list[list[Submap]],
    starts: npt.NDArray[np.int64],
    poses: FloatArray,
    shift: float,
    config: JointConfig,
    watch: Watch,
) -> list[MotionEdge]:
    """Lay bundles of every robot onto the nearest submaps of every other one."""
    found = []
    for moving, track in enumerate(tracks):
        stops = track.stops(config.step)
        for index in watch.shown(stops, f"straightening {track.map_name}", len(stops), "places"):
            here = int(starts[moving]) + index
            for fixed, other in enumerate(tracks):
                if other.map_name == track.map_name:
                    continue
                offset = int(starts[fixed])
                ways = poses[offset : offset + len(other.sensors), :2] - poses[here, :2]
                distances = np.hypot(ways[:, 0], ways[:, 1])
                nearest = sorted(
                    (float(distances[s.first : s.last + 1].min()), k) for k, s in enumerate(submaps[fixed])
                )
                for distance, number in nearest[: config.submaps_per_step]:
                    if distance <= config.reach_m:
                        edge = _closure(track, index, submaps[fixed][number], (here, offset), poses, shift, config)
                        found += [] if edge is None else [edge]
    return found


def _closure(
    track: _Track,
    index: int,
    submap: Submap,
    places: tuple[int, int],
    poses: FloatArray,
    shift: float,
    config: JointConfig,
) -> MotionEdge | None:
    """Return where a bundle lies in another robot's submap, if it fits there and nowhere else near by."""
    here, offset = places
    bundle = track.hits.bundle(index, config.bundle_m, config.match_points)
    if len(bundle.points) < config.search_points // 2:
        return None
    guess = relative_pose(poses, offset + submap.anchor, here)
    find = submap.search(bundle.thinned(config.search_points).points, guess, shift, config.turn_rad)
    if find.ambiguity > config.max_ambiguity:
        return None
    fit = submap.fit(bundle, find.pose)
    if fit.matched < config.min_matched or fit.violated > config.max_violated * fit.matched:
        return None
    eigenvalues = np.linalg.eigvalsh(fit.hessian[:2, :2])
    if eigenvalues[0] < config.min_determined * eigenvalues[1]:
        return None
    floor = np.diag([config.closure_m**2, config.closure_m**2, config.closure_rad**2])
    information = np.linalg.inv(np.linalg.inv(fit.hessian + np.eye(3) * 1e-3) + floor)
    rotation = SE2(0.0, 0.0, fit.pose.theta).matrix()
    return MotionEdge(offset + submap.anchor, here, fit.pose, np.asarray(rotation.T @ information @ rotation))


def _reach_all(tracks: list[_Track], closures: list[MotionEdge]) -> bool:
    """Tell whether closures connect all maps."""
    owner = [track.map_name for track in tracks for _ in range(len(track.sensors))]
    group = {name: name for name in owner}
    for edge in closures:
        joined, absorbed = group[owner[edge.source]], group[owner[edge.target]]
        group = {name: joined if there == absorbed else there for name, there in group.items()}
    return len(set(group.values())) == 1


def _corrected(
    name: str,
    one: TbmMap,
    tracks: list[_Track],
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
