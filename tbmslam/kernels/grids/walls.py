"""Comparison of the walls of one map with another map, for many motions at once."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import BoolArray, FloatArray, Pose, kernel, part
from tbmslam.kernels.arrays import cleared


class Walls(NamedTuple):
    """Surface cells of a map and the map around them."""

    points: FloatArray
    normals: FloatArray
    """Surface cells (N, 2) [m] and unit vectors (N, 2) into the free space."""
    two_sided: BoolArray
    """Whether each cell (N,) has free space on both sides."""
    weights: FloatArray
    """Weight of each cell (N,)."""
    distances: npt.NDArray[np.float32]
    nearest: npt.NDArray[np.int32]
    """Distance from every cell (rows, cols) to the nearest surface cell [m], and the index of that cell."""
    states: npt.NDArray[np.uint8]
    """State of every cell (rows, cols): 0 unknown, 1 free, 2 occupied or contradictory."""
    resolution: float
    origin_x: float
    origin_y: float
    """Side of a cell and origin of the grid [m]."""


FACING = 0.7
"""Least cosine between two normals of the same face of a wall."""


class Limits(NamedTuple):
    """Thresholds of a comparison."""

    agreement: float
    """Largest distance between agreeing walls with similar normals [m]."""
    conflict: float
    """Least distance between a conflicting wall in free space and the walls of the other map [m]."""
    front: float
    """Distance from a wall to the free space from which the robot of the other map would have seen it [m]."""
    facing: float
    """Least cosine between the normals of agreeing walls."""


COMPARED, AGREED, CONFLICTING, UNSEEN, XX, XY, YY, SQUARES = range(8)
"""Columns of the sums of `compare_walls`."""

OUTSIDE, NEITHER, AGREES, CONFLICTS, NOT_SEEN = range(5)
"""Results of `classify_walls` for a wall."""


@part
def facing_cosine(nx: float, ny: float, other_x: float, other_y: float, two_sided: bool) -> float:
    """Return the cosine between the normals of two walls, positive if either wall is two-sided."""
    cosine = nx * other_x + ny * other_y
    return float(abs(cosine) if two_sided else cosine)


class WallPoints(NamedTuple):
    """Some walls of a map, and arrays for their positions in another map."""

    points: FloatArray
    normals: FloatArray
    two_sided: BoolArray
    weights: FloatArray
    """As in `Walls` (K,)."""
    x: FloatArray
    y: FloatArray
    """Positions (K,) in the frame of the other map [m]."""
    cells: npt.NDArray[np.int32]
    """Flat indices (K,) of the cells of the other map; -1 outside."""


@part
def wall_points(walls: Walls, some: npt.NDArray[np.int64]) -> WallPoints:
    """Return some walls (K,) of a map, with uninitialised positions."""
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


@part
def place_walls(moving: WallPoints, fixed: Walls, pose: Pose, back: bool) -> None:
    """Compute the positions of walls in a map for the pose T_fixed_moving, or its inverse with ``back``."""
    tx, ty, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    points, xs, ys, cells = moving.points, moving.x, moving.y, moving.cells
    # Loops without branches are vectorised.
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

    COMPARED: walls in known cells of the fixed map, and those that agree. AGREED: walls near a wall with a similar
    normal. CONFLICTING: walls in free space, far from all walls. UNSEEN: walls in unknown cells although the space in
    front of them is free, so the other robot would have seen them. XX, XY, YY: scatter of the normals of agreeing
    walls. SQUARES: their squared distances.
    """
    sums = cleared(np.empty((len(motions), 8)))
    rows, cols = fixed.states.shape
    distances, nearest, states = fixed.distances.reshape(-1), fixed.nearest.reshape(-1), fixed.states.reshape(-1)
    # Each access to an array of a tuple counts its references, which takes longer than to read the array.
    fixed_normals, fixed_two_sided = fixed.normals, fixed.two_sided
    origin_x, origin_y, resolution = fixed.origin_x, fixed.origin_y, fixed.resolution
    walls = wall_points(moving, some)
    normals, two_sided, weights = walls.normals, walls.two_sided, walls.weights
    xs, ys, cells = walls.x, walls.y, walls.cells
    for m in range(len(motions)):
        pose = (motions[m, 0], motions[m, 1], motions[m, 2])
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        place_walls(walls, fixed, pose, False)
        # Local sums are faster than an array.
        compared = agreed = conflicting = unseen = xx = xy = yy = squares = 0.0
        for i in range(len(some)):
            cell = cells[i]
            if cell < 0:
                continue
            distance, state, weight = distances[cell], states[cell], weights[i]
            nx = cosine * normals[i, 0] - sine * normals[i, 1]
            ny = sine * normals[i, 0] + cosine * normals[i, 1]
            if distance <= limits.agreement:
                near = nearest[cell]
                either = two_sided[i] or fixed_two_sided[near]
                if facing_cosine(nx, ny, fixed_normals[near, 0], fixed_normals[near, 1], either) >= limits.facing:
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
                col = math.floor((xs[i] + limits.front * nx - origin_x) / resolution)
                row = math.floor((ys[i] + limits.front * ny - origin_y) / resolution)
                if 0 <= row < rows and 0 <= col < cols and states[row * cols + col] == 1:
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
def classify_walls(
    moving: Walls, some: npt.NDArray[np.int64], fixed: Walls, motion: Pose, limits: Limits
) -> npt.NDArray[np.uint8]:
    """Return the result of the comparison for each of some walls (K,) and one motion, see `compare_walls`."""
    # This repeats the tests of `compare_walls`, which would take six times as long with a call for each wall.
    found = cleared(np.empty(len(some), dtype=np.uint8))
    points, normals, two_sided = moving.points, moving.normals, moving.two_sided
    distances, nearest, states = fixed.distances, fixed.nearest, fixed.states
    fixed_normals, fixed_two_sided = fixed.normals, fixed.two_sided
    rows, cols = states.shape
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    for i in range(len(some)):
        k = some[i]
        px, py = points[k, 0], points[k, 1]
        x, y = motion[0] + cosine * px - sine * py, motion[1] + sine * px + cosine * py
        col = math.floor((x - fixed.origin_x) / fixed.resolution)
        row = math.floor((y - fixed.origin_y) / fixed.resolution)
        if row < 0 or row >= rows or col < 0 or col >= cols:
            continue
        nx = cosine * normals[k, 0] - sine * normals[k, 1]
        ny = sine * normals[k, 0] + cosine * normals[k, 1]
        distance, state = distances[row, col], states[row, col]
        if distance <= limits.agreement:
            near = nearest[row, col]
            either = two_sided[k] or fixed_two_sided[near]
            if facing_cosine(nx, ny, fixed_normals[near, 0], fixed_normals[near, 1], either) >= limits.facing:
                found[i] = AGREES
                continue
        if state > 0:
            found[i] = CONFLICTS if state == 1 and distance > limits.conflict else NEITHER
        elif distance > limits.agreement:
            col = math.floor((x + limits.front * nx - fixed.origin_x) / fixed.resolution)
            row = math.floor((y + limits.front * ny - fixed.origin_y) / fixed.resolution)
            if 0 <= row < rows and 0 <= col < cols and states[row, col] == 1:
                found[i] = NOT_SEEN
    return found


@kernel
def see_through_walls(moving: Walls, fixed: Walls, motion: Pose, reach: float) -> BoolArray:
    """Return the walls (N,) of the moving map in free space of the fixed map, also along their normals within reach.

    A wall displaced by a deformation is not found, since its counterpart lies within reach along the normal.
    """
    found = cleared(np.empty(len(moving.points), dtype=np.bool_))
    points, normals, states = moving.points, moving.normals, fixed.states
    rows, cols = states.shape
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    steps = max(round(reach / fixed.resolution), 1)
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        x, y = motion[0] + cosine * px - sine * py, motion[1] + sine * px + cosine * py
        nx = cosine * normals[k, 0] - sine * normals[k, 1]
        ny = sine * normals[k, 0] + cosine * normals[k, 1]
        free = True
        for step in range(-steps, steps + 1):
            col = math.floor((x + step * fixed.resolution * nx - fixed.origin_x) / fixed.resolution)
            row = math.floor((y + step * fixed.resolution * ny - fixed.origin_y) / fixed.resolution)
            if row < 0 or row >= rows or col < 0 or col >= cols or states[row, col] != 1:
                free = False
                break
        found[k] = free
    return found
