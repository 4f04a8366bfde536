"""The covariance of an alignment, from the walls that agree.

A wall constrains a map across the wall and not along it; distant walls constrain the rotation. Maps are distorted over
metres, so one metre of wall counts as one measurement, whatever its number of cells. In the frame of the source, at the
centroid of the agreeing walls::

    covariance = inverse(sum over walls of metres * J' J / wall^2 + prior) + bend^2,    J = (nx, ny, x ny - y nx)

with normals n at points (x, y). The parameters were fitted to the errors on `data/map-pairs` and on pairs cut from
other maps; `tools/benchmark.py align` measures the calibration. Real drives are bent as a whole besides, by some tenths
of a degree.
"""

import math

import numpy as np

from merging.config.registration import ExactnessConfig
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.walls import Limits
from tbmslam.map.walls import AGREES, hold

Covariance = tuple[tuple[float, ...], ...]
"""Covariance of an error in x, y [m] and theta [rad] in the source's frame, three rows of three."""

_MANY_WALLS = 4000
"""Number of wall cells of a map that suffices."""


def covariance_of(
    target: WallMap, source: WallMap, T_target_source: SE2, limits: Limits, config: ExactnessConfig
) -> Covariance:
    """Return the covariance of an alignment, from the walls of both maps that agree."""
    metres, points, normals = (
        np.concatenate(both)
        for both in zip(
            _agreeing(source, target, T_target_source, SE2.identity(), limits),
            _agreeing(target, source, T_target_source.inverse(), T_target_source.inverse(), limits),
            strict=True,
        )
    )
    middle = np.average(points, axis=0, weights=metres) if metres.sum() > 0.0 else np.zeros(2)
    x, y = (points - middle).T
    pulls = np.column_stack((normals, x * normals[:, 1] - y * normals[:, 0]))
    information = (pulls * metres[:, None]).T @ pulls / config.wall_m**2
    prior = np.array([config.place_m, config.place_m, config.turn_rad]) ** -2.0
    bend = np.array([config.bend_m, config.bend_m, config.bend_rad]) ** 2
    there = np.linalg.inv(information + np.diag(prior)) + np.diag(bend)
    return seen_from(_rows(there), SE2(float(middle[0]), float(middle[1]), 0.0))


def _agreeing(
    moving: WallMap, fixed: WallMap, T_fixed_moving: SE2, T_source_moving: SE2, limits: Limits
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return half the lengths (N,) of one map's agreeing walls (the other map counts the rest), points and normals."""
    some = moving.some(_MANY_WALLS)
    agree = some[hold(moving.walls, some, fixed.walls, T_fixed_moving, limits) == AGREES]
    cell_m = moving.geometry.resolution * len(moving.points) / max(len(some), 1)
    turn = SE2(0.0, 0.0, T_source_moving.theta)
    return (
        0.5 * cell_m * moving.weights[agree],
        T_source_moving.apply(moving.points[agree]),
        turn.apply(moving.normals[agree]),
    )


def seen_from(covariance: Covariance, T_here_there: SE2) -> Covariance:
    """Return the covariance of the same error in another frame (Sola et al., "A micro Lie theory", eq. 55 and 57)."""
    adjoint = T_here_there.matrix()
    adjoint[:2, 2] = T_here_there.y, -T_here_there.x
    return _rows(adjoint @ np.array(covariance) @ adjoint.T)


def bent_by(covariance: Covariance, apart_m: float, apart_rad: float) -> Covariance:
    """Return the covariance of an alignment enlarged by RMS deviations of its parts [m], [rad].

    It is enlarged at the point where it is smallest.
    """
    x, y = known_best_at(covariance)
    there = np.array(seen_from(covariance, SE2(-x, -y, 0.0))) + np.diag(
        [apart_m**2 / 2.0, apart_m**2 / 2.0, apart_rad**2]
    )
    return seen_from(_rows(there), SE2(x, y, 0.0))


def known_best_at(covariance: Covariance) -> tuple[float, float]:
    """Return the point (x, y) of the source whose position is known best [m]: a rotation error does not move it.

    It is the centroid of the agreeing walls and does not depend on the source's frame.
    """
    turn = covariance[2][2]
    return -covariance[1][2] / turn, covariance[0][2] / turn


def deviations(covariance: Covariance) -> tuple[float, float]:
    """Return the standard deviations of the position at the best known point [m] and of the rotation [rad]."""
    all_ = np.array(covariance)
    turn = float(all_[2, 2])
    place = all_[:2, :2] - np.outer(all_[:2, 2], all_[2, :2]) / turn
    return math.sqrt(max(float(np.trace(place)), 0.0)), math.sqrt(turn)


def _rows(matrix: FloatArray) -> Covariance:
    return tuple(tuple(row) for row in matrix.tolist())
