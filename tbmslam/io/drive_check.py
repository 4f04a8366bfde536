"""What a drive from a file must fulfil before anybody computes with it."""

import numpy as np

from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.drive import Drive

MAX_DISTANCE = 10_000.0
"""Distance [m] at which no robot is believed to have been from its map, nor to have seen anything; it would be walked
step by step for ever."""

MAX_TURN = 1000.0
"""Angle [rad] beyond which a file is not believed."""

MAX_LEVER = 1000.0
"""Distance [m] from its robot at which no laser is believed to be."""


def stray_number(drive: Drive, geometry: GridGeometry) -> str | None:
    """Return an impossible value of a drive in a map of this geometry, as text; None if there is none."""
    keyframes = drive.keyframes
    min_x, min_y, max_x, max_y = geometry.bounds()
    low, high = np.array([min_x, min_y]), np.array([max_x, max_y])
    for what, poses in (("pose", drive.trajectory.poses), ("keyframe", keyframes.poses)):
        outside = np.maximum(low - poses[:, :2], poses[:, :2] - high)
        if (stray := _first(outside, MAX_DISTANCE)) is not None:
            x, y = poses[stray, :2]
            return f"a {what} lies at {x:.3g}, {y:.3g} m, more than {MAX_DISTANCE:.0f} m from the map"
    for what, moves in (("laser", keyframes.sensor_poses), ("beam", keyframes.beam_steps)):
        if (stray := _first(np.abs(moves[:, :2]), MAX_LEVER)) is not None:
            x, y = moves[stray, :2]
            return f"a {what} of the robot lies at {x:.3g}, {y:.3g} m, more than {MAX_LEVER:.0f} m from it"
    lengths = np.abs(keyframes.ranges)
    if (far := lengths[np.isfinite(lengths) & (lengths > MAX_DISTANCE)]).size:
        return f"a beam is {far[0]:.3g} m long, more than {MAX_DISTANCE:.0f} m"
    steps = np.zeros((0, 3)) if drive.motions is None else drive.motions.steps
    if (stray := _first(np.abs(steps[:, :2]), MAX_DISTANCE)) is not None:
        x, y = steps[stray, :2]
        return f"a step of the robot is {x:.3g}, {y:.3g} m, more than {MAX_DISTANCE:.0f} m"
    angles = (drive.trajectory.poses[:, 2:], keyframes.poses[:, 2:], keyframes.sensor_poses[:, 2:], steps[:, 2:])
    for turns in (*angles, keyframes.beam_steps[:, 2:], keyframes.beams[:, :2]):
        if (stray := _first(np.abs(turns), MAX_TURN)) is not None:
            return f"an angle is {np.abs(turns[stray]).max():.3g} rad, more than {MAX_TURN:.0f}"
    return None


def _first(values: FloatArray, limit: float) -> int | None:
    """Return the first row of values (N, C) that holds one above a limit."""
    above = np.flatnonzero((values > limit).any(axis=1))
    return int(above[0]) if len(above) else None
