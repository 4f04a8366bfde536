"""Slow plain twins of the kernels in `tbmslam.kernels.grids.walls`: one wall at a time, by matrices."""

import math

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids.walls import (
    AGREED,
    AGREES,
    COMPARED,
    CONFLICTING,
    CONFLICTS,
    NEITHER,
    NOT_SEEN,
    OUTSIDE,
    SQUARES,
    UNSEEN,
    XX,
    XY,
    YY,
)


def cell_of(fixed, point):
    """Return the (row, col) of a point, or None outside the map."""
    col = math.floor((point[0] - fixed.origin_x) / fixed.resolution)
    row = math.floor((point[1] - fixed.origin_y) / fixed.resolution)
    inside = 0 <= row < fixed.states.shape[0] and 0 <= col < fixed.states.shape[1]
    return (row, col) if inside else None


def cosine(normal, two_sided, fixed, index):
    value = float(normal @ fixed.normals[index])
    return abs(value) if two_sided or fixed.two_sided[index] else value


def held(moving, k, fixed, motion, limits):
    """Return what becomes of a wall."""
    point, normal = motion.apply(moving.points[k]), SE2(0.0, 0.0, motion.theta).apply(moving.normals[k])
    cell = cell_of(fixed, point)
    if cell is None:
        return OUTSIDE
    distance, state = float(fixed.distances[cell]), fixed.states[cell]
    near = distance <= limits.agreement
    if near and cosine(normal, moving.two_sided[k], fixed, fixed.nearest[cell]) >= limits.facing:
        return AGREES
    if state == 1 and distance > limits.conflict:
        return CONFLICTS
    if state > 0:
        return NEITHER
    front = cell_of(fixed, point + limits.front * normal)
    return NOT_SEEN if not near and front is not None and fixed.states[front] == 1 else OUTSIDE


def compared(moving, some, fixed, motion, limits):
    """Return the sums of `compare_walls` for one motion."""
    sums = np.zeros(8)
    for k in some:
        fate, weight = held(moving, k, fixed, motion, limits), moving.weights[k]
        if fate in (AGREES, NEITHER, CONFLICTS):
            sums[COMPARED] += weight
        if fate == CONFLICTS:
            sums[CONFLICTING] += weight
        if fate == NOT_SEEN:
            sums[UNSEEN] += weight
        if fate == AGREES:
            x, y = SE2(0.0, 0.0, motion.theta).apply(moving.normals[k])
            distance = float(fixed.distances[cell_of(fixed, motion.apply(moving.points[k]))])
            sums[[AGREED, XX, XY, YY, SQUARES]] += weight * np.array([1.0, x * x, x * y, y * y, distance**2])
    return sums


def seen_through(moving, k, fixed, motion, reach):
    """Return whether all along a wall's normal, from behind it to before it, is free."""
    point, normal = motion.apply(moving.points[k]), SE2(0.0, 0.0, motion.theta).apply(moving.normals[k])
    most = max(round(reach / fixed.resolution), 1)
    steps = np.arange(-most, most + 1)
    cells = [cell_of(fixed, point + step * fixed.resolution * normal) for step in steps]
    return all(cell is not None and fixed.states[cell] == 1 for cell in cells)


def slid(target, target_some, source, source_some, motion, reach, facing):
    """Return a motion after one step: weighted least squares about the middle of the source's walls."""
    centre = motion.apply(source.points[source_some].mean(axis=0))
    turn = SE2(0.0, 0.0, motion.theta)
    rows, offsets, weights, damping = [], [], [], np.zeros(3)
    for moving, some, fixed, T_fixed_moving in (
        (source, source_some, target, motion),
        (target, target_some, source, motion.inverse()),
    ):
        for k in some:
            point = T_fixed_moving.apply(moving.points[k])
            normal = SE2(0.0, 0.0, T_fixed_moving.theta).apply(moving.normals[k])
            cell = cell_of(fixed, point)
            if cell is None or float(fixed.distances[cell]) > reach:
                continue
            near = fixed.nearest[cell]
            if cosine(normal, moving.two_sided[k], fixed, near) < facing:
                continue
            line, distance = fixed.normals[near], float((point - fixed.points[near]) @ fixed.normals[near])
            if fixed is source:  # in the target's frame, where moving the source moves the line
                point, line, distance = moving.points[k], turn.apply(line), -distance
            arm = point - centre
            rows.append([line[0], line[1], arm[0] * line[1] - arm[1] * line[0]])
            offsets.append(distance)
            weights.append(moving.weights[k] / (1.0 + (distance / (0.5 * reach)) ** 2) ** 2)
            damping += 1e-3 * moving.weights[k] * np.array([1.0, 1.0, float(arm @ arm)])
    if len(rows) < 3:
        return motion
    slopes, pull = np.array(rows), np.array(weights)
    system = (slopes * pull[:, None]).T @ slopes + np.diag(damping + np.array([0.0, 0.0, 1e-12]))
    x, y, theta = np.linalg.solve(system, -(slopes * pull[:, None]).T @ np.array(offsets))
    moved = centre + np.array([x, y]) + SE2(0.0, 0.0, theta).apply(np.array([motion.x, motion.y]) - centre)
    return SE2(float(moved[0]), float(moved[1]), motion.theta + theta)
