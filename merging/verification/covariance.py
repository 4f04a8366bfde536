"""How exactly agreeing walls tell where a map lies.

A wall holds a map across itself, not along; walls far apart hold it from turning. Both of two maps are bent, over a
metre or so as much as over many, so that a metre of wall is one measurement and not as many as it has cells. What is
known of an alignment, in the frame of the source at the middle of what agrees, is therefore::

    covariance = inverse(sum over walls of metres * J' J / wall^2 + prior) + bend^2,    J = (nx, ny, x ny - y nx)

with normals n at points (x, y). A few numbers state the errors of `data/map-pairs` and of pairs cut from other maps
at all overlaps, of rooms and of whole floors; `tools/benchmark.py align` tells how well. Real drives bend besides, as a
whole, by some tenths of a degree.
"""

import math

import numpy as np

from merging.config.verification import ExactnessConfig
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.walls import AGREES, hold
from tbmslam.wall_limits import Limits

Covariance = tuple[tuple[float, ...], ...]
"""Of an error in x, y [m] and theta [rad] in the source's frame, three rows of three."""

_MANY_WALLS = 4000
"""Walls of a map that are enough."""


def covariance_of(
    target: WallMap, source: WallMap, T_target_source: SE2, limits: Limits, config: ExactnessConfig
) -> Covariance:
    """Return how exactly the walls that agree under an alignment tell where the source lies.

    Parameters
    ----------
    target, source
        The maps; either's walls are held against the other.
    T_target_source
        The alignment, from which walls pull the source no farther.
    limits
        When walls agree.
    config
        How exact a metre of wall is.
    """
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
    """Return half the metres (N,) of one map's agreeing walls, the other map sees them too, and where they are."""
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
    """Return the covariance of an alignment whose parts lie apart from where it has them, root mean squares [m], [rad].

    It grows where it is known best.
    """
    x, y = known_best_at(covariance)
    there = np.array(seen_from(covariance, SE2(-x, -y, 0.0))) + np.diag(
        [apart_m**2 / 2.0, apart_m**2 / 2.0, apart_rad**2]
    )
    return seen_from(_rows(there), SE2(x, y, 0.0))


def known_best_at(covariance: Covariance) -> tuple[float, float]:
    """Return the point (x, y) of the source whose place is known best, which an error of the turn does not move [m].

    It is the middle of what agrees, wherever the source has its frame.
    """
    turn = covariance[2][2]
    return -covariance[1][2] / turn, covariance[0][2] / turn


def deviations(covariance: Covariance) -> tuple[float, float]:
    """Return the standard deviations of the place where it is known best [m], and of the turn [rad]."""
    all_ = np.array(covariance)
    turn = float(all_[2, 2])
    place = all_[:2, :2] - np.outer(all_[:2, 2], all_[2, :2]) / turn
    return math.sqrt(max(float(np.trace(place)), 0.0)), math.sqrt(turn)


def _rows(matrix: FloatArray) -> Covariance:
    return tuple(tuple(row) for row in matrix.tolist())
