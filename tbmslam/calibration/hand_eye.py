"""Where the laser sits on the robot, by how odometry and scans say that both moved.

A laser that goes along with a robot turns about it, and a laser that is turned on it drives askew: between two moments

    T_robot_sensor B = A T_robot_sensor

where A is the motion that the odometry tells and B the one that the scans tell. Its translations are linear in the
laser's place and in the cosine and sine of its turn, all of them longer by as much as wheels are larger than they are
thought to be (A. Censi et al., "Simultaneous calibration of odometry and sensor parameters for mobile robots", T-RO
2013). A clock that lags carries the laser ahead as fast as the robot drives: one more unknown.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.calibration.cluster_deviation import deviations_of_parts
from tbmslam.geometry.se2 import FloatArray, compose, inverse
from tbmslam.geometry.trajectory import drive_speeds, turn_rates

_LENGTH, _TURN = 0.5, 0.3
"""Way [m] or turn [rad] of a motion: over less, scans err by as much, and over more the odometry does."""
_LONGEST_S = 20.0
LEAST_ERROR = 0.005
"""Of a motion: scans know it no better [m]."""
_LEAST_SCALE = 1e-6
_ROUNDS = 10
FREE = np.diag([1e-9, 1e-9, 1e-9, 1e-9, 1e-4])
"""What holds unknowns that no motion tells: the place, the turn twice, and the lag."""


class SensorPlace(NamedTuple):
    """A laser's place on the robot, and how well it is known."""

    pose: tuple[float, float, float]
    """T_robot_sensor: x, y [m], theta [rad]."""
    deviations: tuple[float, float, float]
    """Standard deviations of the same."""
    scale: float
    """How many times as far as the scans the odometry went."""


class Motions(NamedTuple):
    """Motions between two moments, and the equations that odometry and scans give of them.

    Parameters
    ----------
    ends
        Between which poses (2, M) there is a motion.
    slopes
        Slopes (M, 2, 5) by the laser's x, y, by cosine and sine of its turn, and by the lag.
    sides
        Right sides (M, 2) [m].
    """

    ends: npt.NDArray[np.int64]
    slopes: FloatArray
    sides: FloatArray


def sensor_place(
    stamps: FloatArray, odometry: FloatArray, sensors: FloatArray, parts: int, least: int
) -> SensorPlace | None:
    """Return where the laser sits; None where there are too few motions.

    Parameters
    ----------
    stamps
        Times (K,) [s] of the poses.
    odometry
        Poses (K, 3) of the robot as the odometry has them; nan where there was none.
    sensors
        Poses (K, 3) of the laser in the map.
    parts
        Parts of the drive, which tell it each by itself: how far they differ is how well it is known.
    least
        Motions that each must have.
    """
    _, slopes, sides = motions_of(stamps, odometry, sensors)
    if len(sides) < parts * least:
        return None
    whole, _ = solved(slopes, sides)
    told = [solved(*part) for part in zip(np.array_split(slopes, parts), np.array_split(sides, parts), strict=True)]
    values, informations = (np.array(some) for some in zip(*told, strict=True))
    deviations = deviations_of_parts(values, informations, whole)
    scale = max(math.hypot(whole[2], whole[3]), _LEAST_SCALE)
    x, y, *_ = (whole / scale).tolist()
    deviation_x, deviation_y, *turn, _ = (deviations / scale).tolist()
    return SensorPlace((x, y, math.atan2(whole[3], whole[2])), (deviation_x, deviation_y, max(turn)), scale)


def turns(stamps: FloatArray, odometry: FloatArray, sensors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much the robot turned by the odometry and the laser by the scans, (M,) each [rad].

    Parameters are those of `sensor_place`. The motions are the same, and a turned laser turns as its robot does.
    """
    first, last = _ends(sensors)
    wheels = np.remainder(odometry[last, 2] - odometry[first, 2] + math.pi, math.tau) - math.pi
    seen = np.remainder(sensors[last, 2] - sensors[first, 2] + math.pi, math.tau) - math.pi
    told = np.isfinite(wheels) & (stamps[last] - stamps[first] < _LONGEST_S)
    return wheels[told], seen[told]


def motions_of(stamps: FloatArray, odometry: FloatArray, sensors: FloatArray) -> Motions:
    """Return the motions of a drive that both know; parameters are those of `sensor_place`."""
    ends = _ends(sensors)
    first, last = ends
    wheels = compose(inverse(odometry[first]), odometry[last])
    seen = compose(inverse(sensors[first]), sensors[last])
    speeds, rates = drive_speeds(stamps, odometry), turn_rates(stamps, sensors[:, 2])
    cosine, sine = np.cos(seen[:, 2]), np.sin(seen[:, 2])
    ahead = speeds[first] - cosine * speeds[last] - rates[first] * wheels[:, 1]
    aside = rates[first] * wheels[:, 0] - sine * speeds[last]
    along = np.column_stack((1.0 - cosine, sine, seen[:, 0], -seen[:, 1], ahead))
    across = np.column_stack((-sine, 1.0 - cosine, seen[:, 1], seen[:, 0], aside))
    slopes, sides = np.stack((along, across), axis=1), wheels[:, :2]
    lasted = stamps[last] - stamps[first]
    told = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(sides).all(axis=1) & (lasted < _LONGEST_S)
    return Motions(ends[:, told], slopes[told], sides[told])


def _ends(sensors: FloatArray) -> npt.NDArray[np.int64]:
    """Return between which poses (2, M) there is a motion."""
    ends, first, poses = [], 0, sensors.tolist()
    x, y, heading = poses[0] if poses else (0.0, 0.0, 0.0)
    for k, (there_x, there_y, turned) in enumerate(poses):
        if math.hypot(there_x - x, there_y - y) >= _LENGTH or abs(math.remainder(turned - heading, math.tau)) >= _TURN:
            ends.append((first, k))
            first, x, y, heading = k, there_x, there_y, turned
    return np.array(ends, dtype=np.int64).reshape(-1, 2).T


def solved(slopes: FloatArray, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns (5,) and their information (5, 5); motions in which wheels slipped lose their say."""
    weights, error, unknowns, curvature = np.ones(len(sides)), 1.0, np.zeros(5), FREE
    # Both equations of each motion, one after the other: products of matrices take a fraction of the time of sums.
    rows, right = slopes.reshape(-1, 5), sides.ravel()
    for _ in range(_ROUNDS):
        weighted = rows * np.repeat(weights, 2)[:, None]
        curvature = weighted.T @ rows + FREE
        unknowns = np.asarray(np.linalg.solve(curvature, weighted.T @ right), dtype=np.float64)
        errors = np.hypot(*(right - rows @ unknowns).reshape(-1, 2).T)
        error = max(1.48 * float(np.median(errors)), LEAST_ERROR)
        weights = 1.0 / (1.0 + (errors / (2.0 * error)) ** 2)
    return unknowns, curvature / error**2
