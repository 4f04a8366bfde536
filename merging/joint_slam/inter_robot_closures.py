"""Loop closures between robots: bundles of keyframes are registered to submaps of all drives."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from merging.config.groups import JointConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.loop_closure.submap import Submap, SubmapConfig, split_into_submaps
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.optimisation.pose_graph import MotionEdge, relative_pose
from tbmslam.parallel.progress import Progress
from tbmslam.tracking.surfel_map import SurfelConfig
from tbmslam.tracking.tracked_keyframe import chain


class Track:
    """A drive in the merged frame, with its submaps.

    Parameters
    ----------
    map_name, drive
        The map and its drive.
    T_merged_map
        Pose of the map.
    config
        The parameters of submaps.

    Attributes
    ----------
    keyframes
        The keyframes in the merged frame.
    sensors
        Poses (K, 3) of the laser.
    hits
        The hits of the scans.
    submaps
        Segments of the drive as targets of bundles.
    """

    def __init__(self, map_name: str, drive: Drive, T_merged_map: SE2, config: SubmapConfig) -> None:
        self.map_name, self.drive = map_name, drive
        self.keyframes: Keyframes = drive.keyframes.transformed(T_merged_map)
        self.sensors = self.keyframes.all_sensor_poses()
        self.hits = DriveHits(ScanHits.of(self.keyframes, config.max_range), self.sensors)
        stretches = split_into_submaps(self.sensors, config.length)
        self.submaps = [Submap(first, last, self.hits, config, SurfelConfig()) for first, last in stretches]

    def chain(self, start: int, config: JointConfig) -> list[MotionEdge]:
        """Return the drive's motions as edges; its first keyframe is the pose `start` of the graph.

        If the measured motions were not stored, they are derived from the poses: with small deviations from keyframe to
        keyframe, and with larger ones where the drive crosses its path, since loops were closed there.
        """
        if self.drive.motions is not None:
            return chain(self.drive.motions, start)
        pairs = [(index, index + 1, config.step_m, config.step_rad) for index in range(len(self.sensors) - 1)]
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
        """Return keyframes about `step` metres apart."""
        _, first = np.unique((self.hits.travelled / step).astype(np.int64), return_index=True)
        return [int(index) for index in first]

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
    starts: npt.NDArray[np.int64],
    poses: FloatArray,
    shift: float,
    config: JointConfig,
    progress: Progress,
) -> list[MotionEdge]:
    """Register bundles of every drive to the nearest submaps of all drives.

    Parameters
    ----------
    tracks
        The drives.
    starts
        Index of the first pose of each drive (D,).
    poses
        Current poses (N, 3) of the lasers at the keyframes of all drives.
    shift
        Largest distance of the search from the current pose [m]; 0 registers without a search.
    config
        The thresholds of a fit.
    progress
        Receives the progress.
    """
    found = []
    for moving, track in enumerate(tracks):
        stops = track.stops(config.step)
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
    if not is_sure and here - index == offset:  # certain loops within a drive are closed already
        return None
    if math.hypot(fit.pose.x - guess.x, fit.pose.y - guess.y) > config.last_shift_m:
        return None
    floor = np.diag([config.closure_m**2, config.closure_m**2, config.closure_rad**2])
    information = np.linalg.inv(np.linalg.inv(_determined(fit.hessian, config) + np.eye(3) * 1e-3) + floor)
    information *= 1.0 if is_sure else config.doubtful_weight
    rotation = SE2(0.0, 0.0, fit.pose.theta).matrix()
    return MotionEdge(offset + submap.anchor, here, fit.pose, np.asarray(rotation.T @ information @ rotation))


def _determined(hessian: FloatArray, config: JointConfig) -> FloatArray:
    """Return the curvature without its undetermined direction, as in `tbmslam.loop_closure.loop_closer`."""
    values, directions = np.linalg.eigh(hessian[:2, :2])
    if values[0] >= config.min_determined * values[1]:
        return hessian
    kept = np.eye(3)
    kept[:2, :2] -= np.outer(directions[:, 0], directions[:, 0])
    closed: FloatArray = kept @ hessian @ kept
    return closed
