"""A keyframe as the tracker left it, and what is known of the motion from one to the next."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tbmslam.laser_scan import LaserScan
from tbmslam.pose_graph import MotionEdge
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2, FloatArray


@dataclass(frozen=True)
class TrackedKeyframe:
    """A scan worth keeping, before loops are closed.

    Parameters
    ----------
    index
        Which reading of the drive it is.
    scan
        The scan.
    T_robot_sensor
        Pose of the laser on the robot.
    match
        Where the tracker placed it.
    variances
        Variances (3,) of x, y [m^2] and theta [rad^2] that the odometry gathered since the last keyframe.
    """

    index: int
    scan: LaserScan
    T_robot_sensor: SE2
    match: ScanMatch
    variances: FloatArray


def chain(keyframes: Sequence[TrackedKeyframe]) -> list[MotionEdge]:
    """Return the tracked motions between consecutive keyframes."""
    return [_edge(number, before, after) for number, (before, after) in enumerate(itertools.pairwise(keyframes))]


def _edge(number: int, before: TrackedKeyframe, after: TrackedKeyframe) -> MotionEdge:
    """Combine what the surfaces and the odometry know of a step, in the later keyframe's frame.

    Both know the pose in the map's frame; a floor stands for what laying scans onto surfaces gets wrong systematically.
    """
    pose = after.match.T_map_sensor
    step = before.match.T_map_sensor.inverse() @ pose
    known = np.diag(1.0 / np.maximum(after.variances, 1e-8))
    if after.match.information is not None:
        known = known + after.match.information
    rotation = SE2(0.0, 0.0, pose.theta).matrix()
    covariance = rotation.T @ np.linalg.inv(known) @ rotation
    distance, turn = np.hypot(step.x, step.y), abs(step.theta)
    position, heading = 0.002 + 0.004 * distance, 0.001 + 0.004 * turn
    covariance = covariance + np.diag([position**2, position**2, heading**2])
    return MotionEdge(number, number + 1, step, np.asarray(np.linalg.inv(covariance), dtype=np.float64))
