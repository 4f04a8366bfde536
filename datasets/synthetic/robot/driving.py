"""A robot follows a path: it looks a little ahead, turns towards what it sees there, and slows down to turn."""

import math
from array import array

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory

RATE = 50.0
"""Samples of a drive a second [Hz]."""

LOOK_AHEAD = 0.3
"""Distance to the point of the path that the robot steers to [m]."""

TURN_RATE = 0.9
"""Largest turn rate [rad/s]."""

_FORWARD_GAIN = 0.6 / RATE  # largest change of speed in a step [m/s]
_TURN_GAIN = 3.0 / RATE  # largest change of turn rate in a step [rad/s]
_MOOD = 8.0  # a driver changes the speed about that often [s]


def drive_along(
    path: FloatArray,
    speed: float,
    rng: np.random.Generator,
    start_stamp: float,
    length: float = math.inf,
    duration: float = math.inf,
) -> Trajectory:
    """Drive along a path (P, 2) [m] of closely spaced points, facing along it at the start.

    Pure pursuit (Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01) with a
    forward speed that falls with the angle to the point pursued, so that the robot turns on the spot where the path
    turns back.

    Parameters
    ----------
    speed
        Largest speed [m/s]; a driver's mood changes it down to 60 % of that.
    start_stamp
        Time of the first pose [s].
    length, duration
        The drive ends after so many metres or seconds, or at the end of the path.

    Returns
    -------
    drive
        Poses at 50 Hz; between them the twist is constant.
    """
    target = _pursued(path, 0, path[0, 0], path[0, 1])
    dx, dy = path[target] - path[0]
    pose = SE2(float(path[0, 0]), float(path[0, 1]), math.atan2(dy, dx))
    poses = array("d", pose)  # plain numbers: a day has millions of poses
    forward, turn, travelled, mood = 0.0, 0.0, 0.0, 1.0
    while travelled < length and len(poses) // 3 <= duration * RATE:
        target = _pursued(path, target, pose.x, pose.y)
        ahead = pose.inverse().apply(path[target])
        if target == len(path) - 1 and math.hypot(*ahead) < 0.05:
            break
        if (len(poses) // 3 - 1) % round(_MOOD * RATE) == 0:
            mood = float(rng.uniform(0.6, 1.0))
        error = math.atan2(ahead[1], ahead[0])
        wanted = mood * speed * max(0.0, math.cos(error)) ** 4 if abs(error) < 0.8 else 0.0
        wanted = min(wanted, max(0.1, 1.5 * math.hypot(*ahead)))
        forward += min(max(wanted - forward, -2.0 * _FORWARD_GAIN), _FORWARD_GAIN)
        wanted_turn = min(max(2.5 * error, -TURN_RATE), TURN_RATE)
        turn += min(max(wanted_turn - turn, -_TURN_GAIN), _TURN_GAIN)
        pose = pose @ SE2.exp(forward / RATE, 0.0, turn / RATE)
        travelled += forward / RATE
        poses.extend(pose)
    return Trajectory(start_stamp + np.arange(len(poses) // 3) / RATE, np.array(poses).reshape(-1, 3))


def _pursued(path: FloatArray, index: int, x: float, y: float) -> int:
    """Return the first point from `index` on that lies further away than the robot looks ahead."""
    while index < len(path) - 1 and math.hypot(path[index, 0] - x, path[index, 1] - y) < LOOK_AHEAD:
        index += 1
    return index
