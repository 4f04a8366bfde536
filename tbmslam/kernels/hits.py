"""Where beams ended, and how what they met faces."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel

FloatArray = npt.NDArray[np.float64]


@kernel
def hit_points(ranges: FloatArray, angle_min: float, angle_increment: float, max_range: float) -> FloatArray:
    """Return the end points (M, 2) [m] of the finite ranges (N,) up to `max_range`, in the order of the beams."""
    points = np.empty((len(ranges), 2))
    count = 0
    for i in range(len(ranges)):
        distance = ranges[i]
        if distance <= max_range and math.isfinite(distance):
            angle = angle_min + i * angle_increment
            points[count, 0], points[count, 1] = distance * math.cos(angle), distance * math.sin(angle)
            count += 1
    return points[:count].copy()


@kernel
def facing_normals(points: FloatArray, apart: int, longest: float) -> FloatArray:
    """Return unit normals (M, 2), towards the origin, of the surfaces on which points (M, 2) in beam order lie.

    A normal is square to the line between the neighbours `apart` places before and after; where that line is longer
    than `longest` [m], or nothing, they lie on something else and the surface is taken to face the origin.
    """
    normals = np.empty_like(points)
    last = len(points) - 1
    for i in range(len(points)):
        before, after = max(i - apart, 0), min(i + apart, last)
        dx, dy = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]
        length = math.hypot(dx, dy)
        if length > longest or length < 1e-6:
            nx, ny = -points[i, 0], -points[i, 1]
            length = max(math.hypot(nx, ny), 1e-12)
        else:
            nx, ny = -dy, dx
            if nx * points[i, 0] + ny * points[i, 1] > 0.0:
                nx, ny = dy, -dx
        normals[i, 0], normals[i, 1] = nx / length, ny / length
    return normals
