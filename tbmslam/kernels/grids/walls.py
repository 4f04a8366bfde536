"""Walls of one map held against another map, for many motions at once."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import BoolArray, FloatArray, Pose, kernel


class Walls(NamedTuple):
    """Surface cells of a map and the map around them."""

    points: FloatArray
    normals: FloatArray
    """Surface cells (N, 2) [m] and unit vectors (N, 2) into the free space."""
    two_sided: BoolArray
    """Which (N,) have free space on both sides."""
    weights: FloatArray
    """How much each (N,) counts."""
    distances: npt.NDArray[np.float32]
    nearest: npt.NDArray[np.int32]
    """From every cell (rows, cols) to the nearest surface cell [m], and its index."""
    states: npt.NDArray[np.uint8]
    """0 unknown, 1 free, 2 known otherwise (rows, cols)."""
    resolution: float
    origin_x: float
    origin_y: float
    """Where the cells lie [m]."""


FACING = 0.7
"""Least cosine between the normals of two walls that may be one wall seen from the same side."""


class Limits(NamedTuple):
    """Distances [m] and a cosine, as the kernels take them."""

    agreement: float
    """Walls nearer to each other than this agree, if they face the same way."""
    conflict: float
    """A wall on free space farther than this from every wall contradicts."""
    front: float
    """Distance before a wall in which the other map must have free space, so that its robot could see the wall."""
    facing: float
    """Least cosine between the normals of walls that may be one."""


COMPARED, AGREED, CONFLICTING, UNSEEN, XX, XY, YY, SQUARES = range(8)
"""What `compare_walls` sums up."""

OUTSIDE, NEITHER, AGREES, CONFLICTS, NOT_SEEN = range(5)
"""What `hold_walls` says of a wall."""


@kernel
def faces(
    nx: float, ny: float, two_sided: bool, other_normals: FloatArray, other_two_sided: BoolArray, index: int
) -> float:
    """Return the cosine between two walls' normals; of walls that face both ways, of the nearer ones."""
    cosine = nx * other_normals[index, 0] + ny * other_normals[index, 1]
    return float(abs(cosine) if two_sided or other_two_sided[index] else cosine)


class WallPoints(NamedTuple):
    """Some walls of a map side by side, and room for where they come to lie on another one."""

    points: FloatArray
    normals: FloatArray
    two_sided: BoolArray
    weights: FloatArray
    """As in `Walls` (K,)."""
    x: FloatArray
    y: FloatArray
    """Where they lie in the other map's frame (K,) [m]."""
    cells: npt.NDArray[np.int32]
    """The number of the cell of the other map that each lies in (K,); -1 outside."""


@kernel
def wall_points(walls: Walls, some: npt.NDArray[np.int64]) -> WallPoints:
    """Return some walls (K,) of a map, which lie nowhere yet."""
    count = len(some)
    return WallPoints(
        walls.points[some],
        walls.normals[some],
        walls.two_sided[some],
        walls.weights[some],
        np.empty(count),
        np.empty(count),
        np.empty(count, dtype=np.int32),
    )


@kernel
def lay(moving: WallPoints, fixed: Walls, pose: Pose, back: bool) -> None:
    """Fill in where walls lie on a map under T_fixed_moving; ``back`` tells that the pose is its inverse."""
    tx, ty, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    points, xs, ys, cells = moving.points, moving.x, moving.y, moving.cells
    # Loops without branches, whose steps the processor takes several at a time.
    if back:
        for i in range(len(points)):
            dx, dy = points[i, 0] - tx, points[i, 1] - ty
            xs[i], ys[i] = cosine * dx + sine * dy, -sine * dx + cosine * dy
    else:
        for i in range(len(points)):
            px, py = points[i, 0], points[i, 1]
            xs[i], ys[i] = tx + cosine * px - sine * py, ty + sine * px + cosine * py
    resolution, origin_x, origin_y = fixed.resolution, fixed.origin_x, fixed.origin_y
    rows, cols = float(fixed.states.shape[0]), float(fixed.states.shape[1])
    for i in range(len(points)):
        col, row = np.floor((xs[i] - origin_x) / resolution), np.floor((ys[i] - origin_y) / resolution)
        inside = (row >= 0.0) & (row < rows) & (col >= 0.0) & (col < cols)
        cells[i] = np.int32(row * cols + col) if inside else np.int32(-1)


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
    distances, nearest, states = fixed.distances.reshape(-1), fixed.nearest.reshape(-1), fixed.states.reshape(-1)
    walls = wall_points(moving, some)
    for m in range(len(motions)):
        pose = (motions[m, 0], motions[m, 1], motions[m, 2])
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        lay(walls, fixed, pose, False)
        # In numbers, not in the array: this loop is a fifth of an alignment.
        compared = agreed = conflicting = unseen = xx = xy = yy = squares = 0.0
        for i in range(len(some)):
            cell = walls.cells[i]
            if cell < 0:
                continue
            distance, state, weight = distances[cell], states[cell], walls.weights[i]
            nx = cosine * walls.normals[i, 0] - sine * walls.normals[i, 1]
            ny = sine * walls.normals[i, 0] + cosine * walls.normals[i, 1]
            if distance <= limits.agreement:
                near = nearest[cell]
                if faces(nx, ny, walls.two_sided[i], fixed.normals, fixed.two_sided, near) >= limits.facing:
                    compared += weight
                    agreed += weight
                    xx += weight * nx * nx
                    xy += weight * nx * ny
                    yy += weight * ny * ny
                    squares += weight * distance * distance
                    continue
            if state > 0:
                compared += weight
                if state == 1 and distance > limits.conflict:
                    conflicting += weight
            elif distance > limits.agreement:
                col = math.floor((walls.x[i] + limits.front * nx - fixed.origin_x) / fixed.resolution)
                row = math.floor((walls.y[i] + limits.front * ny - fixed.origin_y) / fixed.resolution)
                if 0 <= row < rows and 0 <= col < cols and fixed.states[row, col] == 1:
                    unseen += weight
        sums[m, COMPARED], sums[m, AGREED], sums[m, CONFLICTING], sums[m, UNSEEN] = (
            compared,
            agreed,
            conflicting,
            unseen,
        )
        sums[m, XX], sums[m, XY], sums[m, YY], sums[m, SQUARES] = xx, xy, yy, squares
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
            if faces(nx, ny, moving.two_sided[k], fixed.normals, fixed.two_sided, near) >= limits.facing:
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
