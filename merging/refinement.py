"""An alignment made exact: walls slid onto walls until nothing moves."""

import numpy as np

from merging.config import RefinementConfig
from merging.structure import FACING, Structure, alignment_of_normals
from tbmslam.se2 import SE2, FloatArray


def refine(
    target: Structure, source: Structure, T_target_source: SE2, config: RefinementConfig, limit: int | None = None
) -> SE2:
    """Align walls point to line, in both directions, from a first guess (Chen and Medioni 1992; Censi 2008).

    Walls count only with walls that face the same way, within a reach that shrinks from iteration to iteration, and
    each the less the farther it is (Geman-McClure weights), so that what moved or bent does not pull.

    Parameters
    ----------
    target, source
        The maps' walls.
    T_target_source
        The first guess.
    config
        Reach and iterations.
    limit
        At most so many walls of each map look for their like, for speed; None lets all.

    Returns
    -------
    The refined motion; the first guess itself where nothing is near enough to pull.
    """
    motion = T_target_source
    for reach_m in np.geomspace(config.first_reach_m, config.last_reach_m, config.iterations):
        forth = _lines(source, target, motion, reach_m, limit)
        back = _lines(target, source, motion.inverse(), reach_m, limit)
        # What pulls the target onto the source pulls the source the opposite way, seen from the target.
        step = _solve(forth, _seen_from_target(back, motion), reach_m)
        if step is None:
            return motion
        motion = step @ motion
        if reach_m == config.last_reach_m and max(abs(value) for value in step) < 1e-5:
            break
    return motion


_Lines = tuple[FloatArray, FloatArray, FloatArray]
"""Points (N, 2) that should move, normals (N, 2) of the lines they belong to, and their distances (N,) to them."""


def _lines(moving: Structure, fixed: Structure, T_fixed_moving: SE2, reach_m: float, limit: int | None) -> _Lines:
    some = moving.some(limit)
    points = T_fixed_moving.apply(moving.points[some])
    rows, cols, inside = fixed.cells_of(points)
    near = np.flatnonzero(inside & (fixed.distances_m[rows, cols] <= reach_m))
    nearest = fixed.nearest[rows[near], cols[near]]
    normals, turned = fixed.normals[nearest], SE2(0.0, 0.0, T_fixed_moving.theta).apply(moving.normals[some[near]])
    facing = alignment_of_normals(turned, moving.two_sided[some[near]], normals, fixed.two_sided[nearest]) >= FACING
    near, nearest, normals = near[facing], nearest[facing], normals[facing]
    return points[near], normals, np.einsum("ij,ij->i", points[near] - fixed.points[nearest], normals)


def _seen_from_target(lines: _Lines, T_target_source: SE2) -> _Lines:
    points, normals, distances = lines
    return T_target_source.apply(points), SE2(0.0, 0.0, T_target_source.theta).apply(normals), -distances


def _solve(forth: _Lines, back: _Lines, reach_m: float) -> SE2 | None:
    """Return the small motion of the source, in the target's frame, that brings the points nearest to their lines."""
    points, normals, distances = (np.concatenate(parts) for parts in zip(forth, back, strict=True))
    if len(points) < 3:
        return None
    centre = points.mean(axis=0)
    arms = points - centre
    slopes = np.column_stack((normals, arms[:, 0] * normals[:, 1] - arms[:, 1] * normals[:, 0]))
    weights = 1.0 / (1.0 + (distances / (0.5 * reach_m)) ** 2) ** 2
    weighted = slopes * weights[:, None]
    # A little damping keeps a corridor, which does not say how far along it one is, from running away.
    system = weighted.T @ slopes + 1e-3 * len(points) * np.diag([1.0, 1.0, float(np.mean(arms**2))])
    x, y, theta = np.linalg.solve(system, -weighted.T @ distances)
    to_centre = SE2(-float(centre[0]), -float(centre[1]), 0.0)
    about_centre = SE2(float(x), float(y), float(theta))
    return to_centre.inverse() @ about_centre @ to_centre
