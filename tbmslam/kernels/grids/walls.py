"""Walls of one map held against another map, for many motions at once."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import BoolArray, FloatArray, Pose, kernel
from tbmslam.wall_limits import Limits


class Walls(NamedTuple):
    """Surface cells of a map and the map around them.

    Parameters
    ----------
    points, normals
        Surface cells (N, 2) [m] and unit vectors (N, 2) into the free space.
    two_sided
        Which (N,) have free space on both sides.
    weights
        How much each (N,) counts.
    distances, nearest
        From every cell (rows, cols) to the nearest surface cell [m], and its index.
    states
        0 unknown, 1 free, 2 known otherwise (rows, cols).
    resolution, origin_x, origin_y
        Where the cells lie [m].
    """

    points: FloatArray
    normals: FloatArray
    two_sided: BoolArray
    weights: FloatArray
    distances: npt.NDArray[np.float32]
    nearest: npt.NDArray[np.int32]
    states: npt.NDArray[np.uint8]
    resolution: float
    origin_x: float
    origin_y: float


COMPARED, AGREED, CONFLICTING, UNSEEN, XX, XY, YY, SQUARES = range(8)
"""What `compare_walls` sums up."""

OUTSIDE, NEITHER, AGREES, CONFLICTS, NOT_SEEN = range(5)
"""What `hold_walls` says of a wall."""


@kernel
def _faces(
    nx: float, ny: float, two_sided: bool, other_normals: FloatArray, other_two_sided: BoolArray, index: int
) -> float:
    cosine = nx * other_normals[index, 0] + ny * other_normals[index, 1]
    return float(abs(cosine) if two_sided or other_two_sided[index] else cosine)


@kernel
def compare_walls(
    moving: Walls, some: npt.NDArray[np.int64], fixed: Walls, motions: FloatArray, limits: Limits
) -> FloatArray:
    """Return weighted sums (M, 8) over some walls (K,) of the moving map, one row for every motion (M, 3).

    COMPARED are walls where the fixed map knows something or whose front it knows to be free; AGREED those near a wall
    that faces the same way; CONFLICTING those that stand on free space far from all walls; UNSEEN those whose front
    the other robot saw free, so that it must have seen the wall, and did not; XX, XY, YY scatter of the agreeing
    walls' normals; SQUARES their squared distances.
    """
    sums = np.zeros((len(motions), 8))
    rows, cols = fixed.states.shape
    for m in range(len(motions)):
        tx, ty, theta = motions[m, 0], motions[m, 1], motions[m, 2]
        cosine, sine = math.cos(theta), math.sin(theta)
        for k in some:
            px, py = moving.points[k, 0], moving.points[k, 1]
            x, y = tx + cosine * px - sine * py, ty + sine * px + cosine * py
            col = math.floor((x - fixed.origin_x) / fixed.resolution)
            row = math.floor((y - fixed.origin_y) / fixed.resolution)
            if row < 0 or row >= rows or col < 0 or col >= cols:
                continue
            nx = cosine * moving.normals[k, 0] - sine * moving.normals[k, 1]
            ny = sine * moving.normals[k, 0] + cosine * moving.normals[k, 1]
            weight = moving.weights[k]
            distance = fixed.distances[row, col]
            if distance <= limits.agreement:
                faces = _faces(nx, ny, moving.two_sided[k], fixed.normals, fixed.two_sided, fixed.nearest[row, col])
                if faces >= limits.facing:
                    sums[m, COMPARED] += weight
                    sums[m, AGREED] += weight
                    sums[m, XX] += weight * nx * nx
                    sums[m, XY] += weight * nx * ny
                    sums[m, YY] += weight * ny * ny
                    sums[m, SQUARES] += weight * distance * distance
                    continue
            state = fixed.states[row, col]
            if state > 0:
                sums[m, COMPARED] += weight
                if state == 1 and distance > limits.conflict:
                    sums[m, CONFLICTING] += weight
            elif distance > limits.agreement:
                col = math.floor((x + limits.front * nx - fixed.origin_x) / fixed.resolution)
                row = math.floor((y + limits.front * ny - fixed.origin_y) / fixed.resolution)
                if 0 <= row < rows and 0 <= col < cols and fixed.states[row, col] == 1:
                    sums[m, UNSEEN] += weight
    return sums


@kernel
def hold_walls(
    moving: Walls, some: npt.NDArray[np.int64], fixed: Walls, motion: Pose, limits: Limits
) -> npt.NDArray[np.uint8]:
    """Return what becomes of each of some walls (K,) under a motion: which of the sums of `compare_walls` it enters."""
    # The questions are those of `compare_walls`, asked once more: there, a call for each wall takes six times as long.
    found = np.zeros(len(some), dtype=np.uint8)
    rows, cols = fixed.states.shape
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    for i in range(len(some)):
        k = some[i]
        px, py = moving.points[k, 0], moving.points[k, 1]
        x, y = motion[0] + cosine * px - sine * py, motion[1] + sine * px + cosine * py
        col = math.floor((x - fixed.origin_x) / fixed.resolution)
        row = math.floor((y - fixed.origin_y) / fixed.resolution)
        if row < 0 or row >= rows or col < 0 or col >= cols:
            continue
        nx = cosine * moving.normals[k, 0] - sine * moving.normals[k, 1]
        ny = sine * moving.normals[k, 0] + cosine * moving.normals[k, 1]
        distance, state = fixed.distances[row, col], fixed.states[row, col]
        if distance <= limits.agreement:
            near = fixed.nearest[row, col]
            if _faces(nx, ny, moving.two_sided[k], fixed.normals, fixed.two_sided, near) >= limits.facing:
                found[i] = AGREES
                continue
        if state > 0:
            found[i] = CONFLICTS if state == 1 and distance > limits.conflict else NEITHER
        elif distance > limits.agreement:
            col = math.floor((x + limits.front * nx - fixed.origin_x) / fixed.resolution)
            row = math.floor((y + limits.front * ny - fixed.origin_y) / fixed.resolution)
            if 0 <= row < rows and 0 <= col < cols and fixed.states[row, col] == 1:
                found[i] = NOT_SEEN
    return found


@kernel
def see_through_walls(moving: Walls, fixed: Walls, motion: Pose, reach: float) -> BoolArray:
    """Return which walls (N,) of the moving map the fixed one knows to be free, and all before and behind within reach.

    What a bend displaced stands not so far off along its normal, and ends the free space there.
    """
    found = np.zeros(len(moving.points), dtype=np.bool_)
    rows, cols = fixed.states.shape
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    steps = max(round(reach / fixed.resolution), 1)
    for k in range(len(moving.points)):
        px, py = moving.points[k, 0], moving.points[k, 1]
        x, y = motion[0] + cosine * px - sine * py, motion[1] + sine * px + cosine * py
        nx = cosine * moving.normals[k, 0] - sine * moving.normals[k, 1]
        ny = sine * moving.normals[k, 0] + cosine * moving.normals[k, 1]
        free = True
        for step in range(-steps, steps + 1):
            col = math.floor((x + step * fixed.resolution * nx - fixed.origin_x) / fixed.resolution)
            row = math.floor((y + step * fixed.resolution * ny - fixed.origin_y) / fixed.resolution)
            if row < 0 or row >= rows or col < 0 or col >= cols or fixed.states[row, col] != 1:
                free = False
                break
        found[k] = free
    return found


@kernel
def _pull(
    moving: Walls,
    some: npt.NDArray[np.int64],
    fixed: Walls,
    pose: Pose,
    back: bool,
    centre: FloatArray,
    reach: float,
    facing: float,
    system: FloatArray,
) -> None:
    """Add the normal equations (4, 4), upper half, of some walls to be slid onto the fixed map's lines.

    `pose` is T_target_source; `back` tells that the target moves, whose pull on the source is the opposite one.
    """
    tx, ty, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    rows, cols = fixed.states.shape
    xx, xy, xt, xd = (
        system[0, 0],
        system[0, 1],
        system[0, 2],
        system[0, 3],
    )  # in numbers, not in the array: this is the innermost loop of an alignment
    yy, yt, yd = system[1, 1], system[1, 2], system[1, 3]
    tt, td = system[2, 2], system[2, 3]
    pulling, squares, number = system[3, 0], system[3, 1], system[3, 2]
    for k in some:
        px, py = moving.points[k, 0], moving.points[k, 1]
        mx, my = moving.normals[k, 0], moving.normals[k, 1]
        if back:
            x, y = cosine * (px - tx) + sine * (py - ty), -sine * (px - tx) + cosine * (py - ty)
            ux, uy = cosine * mx + sine * my, -sine * mx + cosine * my
        else:
            x, y = tx + cosine * px - sine * py, ty + sine * px + cosine * py
            ux, uy = cosine * mx - sine * my, sine * mx + cosine * my
        col = math.floor((x - fixed.origin_x) / fixed.resolution)
        row = math.floor((y - fixed.origin_y) / fixed.resolution)
        if row < 0 or row >= rows or col < 0 or col >= cols or fixed.distances[row, col] > reach:
            continue
        near = fixed.nearest[row, col]
        if _faces(ux, uy, moving.two_sided[k], fixed.normals, fixed.two_sided, near) < facing:
            continue
        nx, ny = fixed.normals[near, 0], fixed.normals[near, 1]
        distance = (x - fixed.points[near, 0]) * nx + (y - fixed.points[near, 1]) * ny
        if back:  # seen from the target
            x, y, nx, ny, distance = px, py, cosine * nx - sine * ny, sine * nx + cosine * ny, -distance
        weight = moving.weights[k] / (1.0 + (distance / (0.5 * reach)) ** 2) ** 2
        turn = (x - centre[0]) * ny - (y - centre[1]) * nx
        along_x, along_y, along_turn = weight * nx, weight * ny, weight * turn
        xx += along_x * nx
        xy += along_x * ny
        xt += along_x * turn
        xd += along_x * distance
        yy += along_y * ny
        yt += along_y * turn
        yd += along_y * distance
        tt += along_turn * turn
        td += along_turn * distance
        # The damping's share: how many pull, and how far from the centre.
        pulling += moving.weights[k]
        squares += moving.weights[k] * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2)
        number += 1.0
    system[0, 0], system[0, 1], system[0, 2], system[0, 3] = xx, xy, xt, xd
    system[1, 1], system[1, 2], system[1, 3] = yy, yt, yd
    system[2, 2], system[2, 3] = tt, td
    system[3, 0], system[3, 1], system[3, 2] = pulling, squares, number


@kernel
def _solved(system: FloatArray) -> Pose:
    """Return the step that solves the symmetric normal equations: left three columns, right side negative."""
    a, b, c = system[0, 0], system[0, 1], system[0, 2]
    d, e, f = system[1, 1], system[1, 2], system[2, 2]
    p, q, r = -system[0, 3], -system[1, 3], -system[2, 3]
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * aa + b * ab + c * ac
    if abs(determinant) < 1e-300:
        return 0.0, 0.0, 0.0
    return (
        (aa * p + ab * q + ac * r) / determinant,
        (ab * p + bb * q + bc * r) / determinant,
        (ac * p + bc * q + cc * r) / determinant,
    )


@kernel
def slide_walls(
    target: Walls,
    target_some: npt.NDArray[np.int64],
    source: Walls,
    source_some: npt.NDArray[np.int64],
    motions: FloatArray,
    reaches: FloatArray,
    facing: float,
) -> FloatArray:
    """Return motions T_target_source (M, 3) after sliding walls onto walls in both directions, once for every reach."""
    slid = motions.copy()
    middle = np.zeros(2)
    for k in source_some:
        middle[0] += source.points[k, 0] / len(source_some)
        middle[1] += source.points[k, 1] / len(source_some)
    system = np.empty((4, 4))
    centre = np.empty(2)
    for m in range(len(slid)):
        x, y, theta = slid[m, 0], slid[m, 1], slid[m, 2]
        for reach in reaches:
            system[:] = 0.0
            cosine, sine = math.cos(theta), math.sin(theta)
            centre[0] = x + cosine * middle[0] - sine * middle[1]
            centre[1] = y + sine * middle[0] + cosine * middle[1]
            pose = (x, y, theta)
            _pull(source, source_some, target, pose, False, centre, reach, facing, system)
            _pull(target, target_some, source, pose, True, centre, reach, facing, system)
            if system[3, 2] < 3.0:
                break
            # A little damping keeps a corridor, which does not say how far along it one is, from running away.
            system[0, 0] += 1e-3 * system[3, 0]
            system[1, 1] += 1e-3 * system[3, 0]
            system[2, 2] += 1e-3 * system[3, 1] + 1e-12
            step_x, step_y, turn = _solved(system)
            dx, dy = x - centre[0], y - centre[1]
            cosine, sine = math.cos(turn), math.sin(turn)
            x = centre[0] + step_x + cosine * dx - sine * dy
            y = centre[1] + step_y + sine * dx + cosine * dy
            theta += turn
        slid[m, 0], slid[m, 1], slid[m, 2] = x, y, theta
    return slid
