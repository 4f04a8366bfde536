"""An alignment made exact where both maps are bent: how far walls lie apart is a motion, and a field that is smooth.

Walls that slide onto walls (`merging.candidates.refine_all`) pull each by itself, as if what is left of their distances
were noise. It is not: a map that is bent is off by nearly the same for metres, so that a room full of walls tells where
that room lies and little more than a bare one does. Universal kriging (Matheron, "Le krigeage universel", 1969;
Cressie, "Statistics for Spatial Data", 1993, section 3.4) says so. Of distances d along the normals n of walls at p,

    d = -J motion + n . u(p) + noise,    covariance of u(p), u(q) = bend^2 exp(-|p - q| / length) I,

the motion is that of generalised least squares, motion = -inverse(J' inverse(C) J) J' inverse(C) d, where C is the
covariance of all that is no motion.
"""

import math
from typing import NamedTuple

import numpy as np

from merging.bending_config import KrigingConfig
from merging.config import ExactnessConfig, MergeConfig
from merging.structure import Structure
from tbmslam.kernels.triangular import factorise, solve
from tbmslam.se2 import SE2, FloatArray
from tbmslam.wall_limits import FACING, Limits
from tbmslam.walls import AGREES, hold

_WAYS = 8
"""Walls of one patch face the same way to within a turn by so many."""
_LEAST = 0.05
"""A patch that counts less than this many walls is left out."""


class _Gaps(NamedTuple):
    """Where walls lie, or patches of them (N, 2) [m], normals (N, 2), distances (N,) [m], how much each counts (N,).

    All in the target's frame; the distance is the source's wall's from the target's, along the normal.
    """

    points: FloatArray
    normals: FloatArray
    metres: FloatArray
    weights: FloatArray


def krige(target: Structure, source: Structure, T_target_source: SE2, config: MergeConfig) -> SE2:
    """Make an alignment of bent maps exact.

    Parameters
    ----------
    target, source
        The maps.
    T_target_source
        The alignment, which brings the walls together already.
    config
        How bent maps are, and how exact the alignment is before any wall is counted.
    """
    how, motion = config.kriging, T_target_source
    for _ in range(how.iterations):
        gaps = _patches(_gaps(target, source, motion, config), how)
        if len(gaps.metres) < how.min_patches:
            return motion
        motion = _step(gaps, how, config.exactness) @ motion
    return motion


def _gaps(target: Structure, source: Structure, motion: SE2, config: MergeConfig) -> _Gaps:
    """Return how far walls of either map lie from those of the other that face the same way."""
    points, normals, metres, weights = _beside(source, target, motion, config)
    back = motion.inverse()
    own, facing, behind, counts = _beside(target, source, back, config)
    return _Gaps(
        np.concatenate((points, motion.apply(own))),
        np.concatenate((normals, SE2(0.0, 0.0, motion.theta).apply(facing))),
        np.concatenate((metres, -behind)),
        np.concatenate((weights, counts)),
    )


def _beside(moving: Structure, fixed: Structure, T_fixed_moving: SE2, config: MergeConfig) -> _Gaps:
    """Return how far walls of the moving map lie from the fixed one's, in the fixed one's frame."""
    how = config.kriging
    some = moving.some(config.refinement.many_walls)
    limits = Limits(how.reach_m, how.reach_m, 0.0, FACING)
    some = some[hold(moving.walls, some, fixed.walls, T_fixed_moving, limits) == AGREES]
    points = T_fixed_moving.apply(moving.points[some])
    walls = fixed.walls
    cols, rows = np.floor((points - (walls.origin_x, walls.origin_y)) / walls.resolution).astype(np.int64).T
    near = fixed.nearest[rows, cols]
    normals = fixed.normals[near]
    metres = ((points - fixed.points[near]) * normals).sum(axis=1)
    # What moved or was not there lies far off, and must not pull (Geman and McClure).
    return _Gaps(points, normals, metres, moving.weights[some] / (1.0 + (metres / how.width_m) ** 2) ** 2)


def _patches(gaps: _Gaps, how: KrigingConfig) -> _Gaps:
    """Return the averages of walls that lie in one patch of floor and face the same way."""
    side_m = how.patch_m
    ways = np.round(np.arctan2(gaps.normals[:, 1], gaps.normals[:, 0]) * _WAYS / math.tau) % _WAYS
    while True:
        cells = np.column_stack((np.floor(gaps.points / side_m), ways))
        members = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        count = int(members.max(initial=-1)) + 1
        if count <= how.most_patches:
            break
        side_m *= math.sqrt(2.0)
    counts = np.bincount(members, gaps.weights, count).astype(np.float64)
    averages = [
        np.bincount(members, gaps.weights * column, count) / np.maximum(counts, _LEAST)
        for column in (*gaps.points.T, *gaps.normals.T, gaps.metres)
    ]
    x, y, nx, ny, metres = (average[counts >= _LEAST] for average in averages)
    return _Gaps(np.column_stack((x, y)), np.column_stack((nx, ny)), metres, counts[counts >= _LEAST])


def _step(gaps: _Gaps, how: KrigingConfig, before: ExactnessConfig) -> SE2:
    """Return the motion in the target's frame that closes the gaps but for what is smooth."""
    (x, y), (nx, ny) = gaps.points.T, gaps.normals.T
    apart = np.hypot(x[:, None] - x, y[:, None] - y)
    covariance = how.bend_m**2 * np.exp(-apart / how.length_m) * (nx[:, None] * nx + ny[:, None] * ny)
    covariance[np.diag_indices_from(covariance)] += how.patch_noise_m**2 + how.cell_noise_m**2 / gaps.weights
    factor = factorise(covariance)
    middle = gaps.points.mean(axis=0)
    pulls = np.column_stack((nx, ny, (x - middle[0]) * ny - (y - middle[1]) * nx))
    weighed = np.ascontiguousarray(pulls.T)
    for row in weighed:
        solve(factor, row)
    # Along a corridor, where nothing pulls, it stays where it is.
    prior = np.diag([before.place_m**-2.0, before.place_m**-2.0, before.turn_rad**-2.0])
    dx, dy, turn = np.linalg.solve(weighed @ pulls + prior, -(weighed @ gaps.metres)).tolist()
    there = SE2(float(middle[0]), float(middle[1]), 0.0)
    return there @ SE2(dx, dy, turn) @ there.inverse()
