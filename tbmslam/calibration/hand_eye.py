"""Hand-eye calibration: the pose of the laser on the robot from the motions of odometry and scans.

Between two moments

    A T_robot_sensor = T_robot_sensor B

where A is the motion of the robot by odometry and B the motion of the laser by scans. The translations are linear in
the position of the laser and in the cosine and sine of its rotation. An error of the odometry's scale multiplies all
four (A. Censi et al., "Simultaneous calibration of odometry and sensor parameters for mobile robots", T-RO 2013). A lag
of the clock displaces the laser along the robot's velocity; it is the fifth unknown.
"""

import math
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray, IntArray, compose, inverse, wrap_angles
from tbmslam.geometry.trajectory import drive_speeds, turn_rates

_LENGTH, _TURN = 0.5, 0.3
"""Distance [m] or rotation [rad] of a motion: the scans err over shorter motions, the odometry over longer ones."""
_LONGEST_S = 20.0
_LEAST_ERROR = 0.005
"""Smallest standard deviation of a motion by scans [m]."""
_LEAST_SCALE = 1e-6
_ROUNDS = 5
"""Rounds of reweighting. On four recordings more rounds change no pose by more than a twentieth of its deviation."""
FREE = np.diag([1e-9, 1e-9, 1e-9, 1e-9, 1e-4])
"""Prior information of the unknowns: position, cosine and sine, and the lag."""


class SensorPlace(NamedTuple):
    """The estimated pose of a laser on the robot, and the scale and the lag of the odometry."""

    pose: tuple[float, float, float]
    """T_robot_sensor: x, y [m], theta [rad]."""
    deviations: tuple[float, float, float]
    """Standard deviations of the same."""
    scale: float
    """Distance by odometry divided by distance by scans."""
    lag: float
    """Time by which the odometry at a scan is too old [s]."""
    lag_deviation: float
    """Standard deviation of the lag [s]."""


class Lag(NamedTuple):
    """The estimated lag of the odometry."""

    seconds: float
    """Time by which the odometry at a scan is too old [s]."""
    deviation: float
    """Its standard deviation [s]."""


class Motions(NamedTuple):
    """Motions between two poses each, with M rotations and linear equations."""

    ends: IntArray
    """Indices of the first and the last pose of each motion (2, M)."""
    slopes: FloatArray
    """Coefficients (M, 2, 5) of the laser's x, y, of the cosine and sine of its rotation, and of the lag."""
    sides: FloatArray
    """Right sides (M, 2) [m]."""
    turns: FloatArray
    """Rotations (M, 2) of the robot by odometry and of the laser by scans, equal whatever its pose is [rad]."""


def sensor_place(motions: Motions, parts: int, least: int) -> SensorPlace | None:
    """Estimate the pose of the laser on the robot; None if there are too few motions.

    The drive is divided into `parts` with at least `least` motions each. The differences of their estimates give the
    standard deviations.
    """
    slopes, sides = motions.slopes, motions.sides
    if len(sides) < parts * least:
        return None
    whole, deviations = estimated(slopes, sides, parts)
    scale = max(math.hypot(whole[2], whole[3]), _LEAST_SCALE)
    x, y, *_ = (whole / scale).tolist()
    deviation_x, deviation_y, *turn, _ = (deviations / scale).tolist()
    pose = x, y, math.atan2(whole[3], whole[2])
    return SensorPlace(pose, (deviation_x, deviation_y, max(turn)), scale, float(whole[4]), float(deviations[4]))


def turn_lag(stamps: FloatArray, odometry: FloatArray, sensors: FloatArray, parts: int) -> Lag | None:
    """Estimate the lag from the rotations of a drive in `parts`; None if there are fewer motions than parts.

    The poses are those of `motions_of`. By a lag, rotations by odometry and by scans differ as much as the turn rate
    changed. This is linear for short lags only, so the odometry is shifted by the lag, and the rest is estimated again.
    The pose of the laser does not matter, and late odometry displaces scans more than it turns them. If the stamps of
    four recordings are shifted by up to 0.3 s, this lag is wrong by at most 0.05 s, and the lag of `sensor_place` by up
    to 0.15 s.
    """
    known = np.isfinite(odometry).all(axis=1)
    stamps, sensors, headings = stamps[known], sensors[known], np.unwrap(odometry[known, 2])
    ends = _ends(sensors)
    ends = ends[:, stamps[ends[1]] - stamps[ends[0]] < _LONGEST_S]
    if ends.shape[1] < parts:
        return None
    seen = np.diff(sensors[:, 2][ends], axis=0)[0]
    slopes, sides = np.zeros((len(seen), 2, 5)), np.zeros((len(seen), 2))
    is_steady = bool((np.diff(stamps) > 0.0).all())  # else nothing can be shifted
    lag, deviation, turned = 0.0, math.inf, headings
    for _ in range(_ROUNDS if is_steady else 1):
        slopes[:, 0, -1] = np.diff(turn_rates(stamps, turned)[ends], axis=0)[0]
        sides[:, 0] = wrap_angles(seen - np.diff(turned[ends], axis=0)[0])
        unknowns, deviations = estimated(slopes, sides, parts)
        lag, deviation = lag + float(unknowns[-1]), float(deviations[-1])
        turned = np.interp(stamps + lag, stamps, headings)
    return Lag(lag, deviation)


def estimated(slopes: FloatArray, sides: FloatArray, parts: int) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns (5,) and their standard deviations (5,) by the differences of the parts of a drive."""
    whole, _ = _solved(slopes, sides)
    by_part = [_solved(*part) for part in zip(np.array_split(slopes, parts), np.array_split(sides, parts), strict=True)]
    values, informations = (np.array(column) for column in zip(*by_part, strict=True))
    return whole, deviations_of_parts(values, informations, whole)


def motions_of(stamps: FloatArray, odometry: FloatArray, sensors: FloatArray) -> Motions:
    """Return the motions of a drive with their equations.

    `odometry` (K, 3) are the poses of the robot by odometry at times (K,) [s], nan if unknown, and `sensors` (K, 3)
    those of the laser in the map.
    """
    ends = _ends(sensors)
    if not ends.size:
        return Motions(ends, np.zeros((0, 2, 5)), np.zeros((0, 2)), np.zeros((0, 2)))
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
    duration = stamps[last] - stamps[first]
    usable = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(sides).all(axis=1) & (duration < _LONGEST_S)
    turns = np.column_stack((wheels[:, 2], seen[:, 2]))
    return Motions(ends[:, usable], slopes[usable], sides[usable], turns[usable])


def _ends(sensors: FloatArray) -> IntArray:
    """Return the first and the last pose of each motion (2, M)."""
    ends, first, poses = [], 0, sensors.tolist()
    x, y, heading = poses[0] if poses else (0.0, 0.0, 0.0)
    for k, (there_x, there_y, turned) in enumerate(poses):
        if math.hypot(there_x - x, there_y - y) >= _LENGTH or abs(math.remainder(turned - heading, math.tau)) >= _TURN:
            ends.append((first, k))
            first, x, y, heading = k, there_x, there_y, turned
    return np.array(ends, dtype=np.int64).reshape(-1, 2).T


def _solved(slopes: FloatArray, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the robust estimate of the unknowns (5,) and its information (5, 5); outliers are slipping wheels."""
    weights, error, unknowns, curvature = np.ones(len(sides)), 1.0, np.zeros(5), FREE
    # All equations in one matrix: matrix products are much faster than sums over motions.
    rows, right = slopes.reshape(-1, 5), sides.ravel()
    for _ in range(_ROUNDS):
        weighted = rows * np.repeat(weights, 2)[:, None]
        curvature = weighted.T @ rows + FREE
        unknowns = np.asarray(np.linalg.solve(curvature, weighted.T @ right), dtype=np.float64)
        errors = np.hypot(*(right - rows @ unknowns).reshape(-1, 2).T)
        weights, error = robust_weights(errors)
    return unknowns, curvature / error**2


def robust_weights(errors: FloatArray) -> tuple[FloatArray, float]:
    """Return the weights of motions by their errors (M,) [m], and the standard deviation of the inliers [m]."""
    error = max(1.48 * float(np.median(errors)), _LEAST_ERROR)
    weights: FloatArray = 1.0 / (1.0 + (errors / (2.0 * error)) ** 2)
    return weights, error


def deviations_of_parts(values: FloatArray, informations: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of a joint estimate (n,): the larger of the formal and the empirical ones.

    The formal ones follow from the informations A_p (P, n, n) of the estimates v_p (P, n) of P >= 2 parts, and their
    sum A. The empirical ones are the roots of the diagonal of

        P / (P - 1)  A^-1  sum_p A_p (v_p - m) (v_p - m)^T A_p  A^-1

    which is valid even if the informations are wrong (K.-Y. Liang, S. Zeger, "Longitudinal data analysis using
    generalized linear models", Biometrika 1986, its V_G for P clusters).
    """
    parts = len(values)
    formal = np.linalg.inv(informations.sum(axis=0))
    residuals = np.einsum("pij,pj->pi", informations, values - mean)
    empirical = formal @ (residuals.T @ residuals) @ formal * parts / (parts - 1)
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(formal), np.diag(empirical)))
    return deviations
