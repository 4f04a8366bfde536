"""Keyframes as tracked, and the motions between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray, compose, inverse, stacked
from tbmslam.map.drive import DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracker import ScanMatch


@dataclass(frozen=True, slots=True)
class TrackedKeyframe:
    """A keyframe before loop closing."""

    index: int
    """Index of its reading in the drive."""
    outline: LaserScan
    """The scan without its ranges."""
    ranges: npt.NDArray[np.float32]
    """The ranges, in half the memory: a day's drive has some hundred thousand keyframes."""
    T_robot_sensor: SE2
    match: ScanMatch
    prior: FloatArray
    """Information (3, 3) of the laser's pose in the map's frame from the motion since the last keyframe, weighted by
    `match.trust`."""
    T_odom_robot: SE2 | None = None
    """Pose of the robot by odometry; None if unknown."""
    follows_gap: bool = False
    """Whether keyframes before it were forgotten. Its prior then does not come from odometry."""

    @classmethod
    def of(
        cls,
        index: int,
        scan: LaserScan,
        T_robot_sensor: SE2,
        match: ScanMatch,
        prior: FloatArray,
        T_odom_robot: SE2 | None = None,
    ) -> "TrackedKeyframe":
        """Return a keyframe with a scan."""
        ranges = scan.ranges.astype(np.float32)
        return cls(index, scan.with_ranges(_NO_RANGES), ranges, T_robot_sensor, match, prior, T_odom_robot)

    @property
    def scan(self) -> LaserScan:
        """The scan."""
        return self.outline.with_ranges(self.ranges.astype(np.float64))

    def with_scan(self, scan: LaserScan) -> "TrackedKeyframe":
        """Return the keyframe with another scan."""
        return replace(self, outline=scan.with_ranges(_NO_RANGES), ranges=scan.ranges.astype(np.float32))

    def moved(self, T_new_map: SE2) -> "TrackedKeyframe":
        """Return the keyframe in another frame of the map."""
        match = self.match._replace(T_map_sensor=T_new_map @ self.match.T_map_sensor)
        rotation = SE2(0.0, 0.0, T_new_map.theta).matrix()
        if match.information is not None:
            match = match._replace(information=rotation @ match.information @ rotation.T)
        return replace(self, match=match, prior=rotation @ self.prior @ rotation.T)


_NO_RANGES = np.zeros(0)
_NO_ODOMETRY = math.nan, math.nan, math.nan


def packed(keyframes: Sequence[TrackedKeyframe], poses: FloatArray) -> Keyframes:
    """Return the keyframes of a map at poses (K, 3) of the robot."""
    # By arrays, in a quarter of the time of `Keyframes.from_scans`.
    outlines = [k.outline for k in keyframes]
    return Keyframes(
        stamps=np.array([o.stamp for o in outlines], dtype=np.float64),
        poses=poses,
        sensor_poses=stacked([k.T_robot_sensor for k in keyframes]),
        beams=np.array(
            [(o.angle_min, o.angle_increment, o.range_min, o.range_max) for o in outlines], dtype=np.float64
        ).reshape(-1, 4),
        offsets=np.cumsum([0, *(len(k.ranges) for k in keyframes)]),
        ranges=np.concatenate([_NO_RANGES.astype(np.float32), *(k.ranges for k in keyframes)]),
        beam_steps=stacked([o.beam_step for o in outlines]),
        indices=np.array([k.index for k in keyframes], dtype=np.int64),
    )


def odometry(keyframes: Sequence[TrackedKeyframe]) -> FloatArray:
    """Return the poses (K, 3) of the robot by odometry; nan if unknown."""
    return stacked([k.T_odom_robot or _NO_ODOMETRY for k in keyframes])


def informations(keyframes: Sequence[TrackedKeyframe]) -> tuple[FloatArray, FloatArray]:
    """Return the informations (K - 1, 3, 3) of the scan and of the odometry about each step; 0 for an unknown one."""
    unknown, later = np.zeros((3, 3)), keyframes[1:]
    seen: FloatArray = np.array([unknown if k.match.information is None else k.match.information for k in later])
    return seen.reshape(-1, 3, 3), np.array([k.prior for k in later]).reshape(-1, 3, 3)


def motions(keyframes: Sequence[TrackedKeyframe]) -> DriveMotions:
    """Return the tracked motions between consecutive keyframes.

    The informations of the scan and of the odometry about each step are combined. Both are in the map's frame; an edge
    has the frame of the later keyframe. A least variance represents the systematic errors of the registration.
    """
    if len(keyframes) < 2:
        return DriveMotions(np.zeros((0, 3)), np.zeros((0, 3, 3)))
    poses = poses_of_sensor(keyframes)
    steps = compose(inverse(poses[:-1]), poses[1:])
    seen, wheels = informations(keyframes)
    rotations = np.zeros_like(seen)
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(poses[1:, 2])
    rotations[:, 1, 0] = np.sin(poses[1:, 2])
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    distance, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    position, heading = 0.002 + 0.004 * distance, 0.001 + 0.004 * turn
    floor = np.column_stack((position, position, heading))[:, :, None] ** 2 * np.eye(3)
    covariances = np.swapaxes(rotations, 1, 2) @ np.linalg.inv(seen + wheels) @ rotations + floor
    of_steps = np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    return DriveMotions(steps, of_steps)


def chain(measured: DriveMotions, first: int = 0) -> list[MotionEdge]:
    """Return motions as edges between consecutive poses of a graph, beginning at one."""
    return [
        MotionEdge(first + number, first + number + 1, SE2(*step), information)
        for number, (step, information) in enumerate(zip(measured.steps.tolist(), measured.informations, strict=True))
    ]


def poses_of_sensor(keyframes: Sequence[TrackedKeyframe]) -> FloatArray:
    """Return the poses (K, 3) of the laser as tracked."""
    return stacked([k.match.T_map_sensor for k in keyframes])
