"""Drives whose tracked heading drifts as they go on."""

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.pose_graph import relative_pose


def drifting_keyframes(robot, turn_per_metre, every):
    """Return true and drifting laser poses of a keyframe every so many metres, and what they hit."""
    true, kept = [robot.truth.pose(k) @ r.T_robot_sensor for k, r in enumerate(robot.readings)], [0]
    for k, pose in enumerate(true):
        step = true[kept[-1]].inverse() @ pose
        if np.hypot(step.x, step.y) > every or abs(step.theta) > 0.3:
            kept.append(k)
    true = np.array([true[k] for k in kept])
    tracked = [SE2.from_array(true[0])]
    for k in range(1, len(true)):
        step = relative_pose(true, k - 1, k)
        tracked.append(tracked[-1] @ SE2(step.x, step.y, step.theta + turn_per_metre * np.hypot(step.x, step.y)))
    return true, np.array(tracked), packed([robot.readings[k].scan for k in kept])


def packed(scans):
    return ScanHits.of(Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2), 40.0)


def errors(true, poses):
    return np.hypot(*(poses - true)[:, :2].T)
