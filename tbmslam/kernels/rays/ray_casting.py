"""Exact ranges from a laser to wall segments in simulated worlds."""

import math

import numpy as np

from tbmslam.kernels import FloatArray, kernel, part


@kernel
def cast_rays(
    walls: FloatArray, sensors: FloatArray, angle_min: float, angle_increment: float, limit: float, ranges: FloatArray
) -> None:
    """Write the distance to the nearest wall along every beam of every scan; `inf` if no wall lies within `limit`.

    As in a depth buffer, each segment is only compared with the interval of beams that it covers. The beams must span
    at most one full turn. `walls` (N, 4) are segments x0, y0, x1, y1 [m] in the world, and `sensors` (S, 3) the poses
    of the laser. `angle_min` is the direction of the first beam and `angle_increment` the step between beams, which may
    be negative [rad]. `ranges` (S, B) receives the result [m].
    """
    beams = ranges.shape[1]
    cosines, sines = np.empty(beams), np.empty(beams)
    for beam in range(beams):
        cosines[beam] = math.cos(angle_min + beam * angle_increment)
        sines[beam] = math.sin(angle_min + beam * angle_increment)
    # Half a step beyond the first and the last beam.
    half = 0.5 * abs(angle_increment)
    turned = angle_min if angle_increment > 0.0 else angle_min + (beams - 1) * angle_increment
    low, high = turned - half, turned + (2 * beams - 1) * half
    narrow = high - low < 0.9 * math.pi
    edges = (math.cos(low), math.sin(low), math.cos(high), math.sin(high))
    for scan in range(len(sensors)):
        nearest = ranges[scan]
        nearest[:] = np.inf
        x, y, theta = sensors[scan, 0], sensors[scan, 1], sensors[scan, 2]
        cosine, sine = math.cos(theta), math.sin(theta)
        for wall in range(len(walls)):
            dx, dy = walls[wall, 0] - x, walls[wall, 1] - y
            x0, y0 = cosine * dx + sine * dy, cosine * dy - sine * dx
            dx, dy = walls[wall, 2] - x, walls[wall, 3] - y
            x1, y1 = cosine * dx + sine * dy, cosine * dy - sine * dx
            if _out_of_reach(x0, y0, x1, y1, limit) or (narrow and _beside(x0, y0, x1, y1, edges)):
                continue
            _cover(x0, y0, x1, y1, angle_min, angle_increment, cosines, sines, nearest)
        for beam in range(beams):
            if nearest[beam] > limit:
                nearest[beam] = np.inf


@part
def _out_of_reach(x0: float, y0: float, x1: float, y1: float, limit: float) -> bool:
    return min(x0, x1) > limit or max(x0, x1) < -limit or min(y0, y1) > limit or max(y0, y1) < -limit


@part
def _beside(x0: float, y0: float, x1: float, y1: float, edges: tuple[float, float, float, float]) -> bool:
    """Return whether a segment lies entirely right of the rightmost beam or left of the leftmost beam."""
    low_x, low_y, high_x, high_y = edges
    return (low_x * y0 < low_y * x0 and low_x * y1 < low_y * x1) or (
        high_x * y0 > high_y * x0 and high_x * y1 > high_y * x1
    )


@part
def _cover(
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    angle_min: float,
    angle_increment: float,
    cosines: FloatArray,
    sines: FloatArray,
    nearest: FloatArray,
) -> None:
    """Update the ranges of the beams that one segment, in the sensor's frame, covers."""
    cross = x0 * y1 - y0 * x1
    span = math.atan2(cross, x0 * x1 + y0 * y1)
    if span == 0.0:
        return
    step = abs(angle_increment)
    # Angle from the first beam to the end of the segment that the beams meet first, in [0, 2 pi).
    first_angle = math.atan2(y0, x0) if (span > 0.0) == (angle_increment > 0.0) else math.atan2(y1, x1)
    turned = (first_angle - angle_min) * (1.0 if angle_increment > 0.0 else -1.0)
    turned %= 2.0 * math.pi
    # The line is normal . p = offset, so a beam in direction d meets it at range offset / (normal . d).
    normal_x, normal_y = y1 - y0, x0 - x1
    for _ in range(2):  # a full turn earlier the second time, for a segment across the first beam
        # The tolerance closes the gaps between touching segments that rounding would leave.
        first = max(0, math.ceil(turned / step - 1e-7))
        last = min(len(nearest) - 1, math.floor((turned + abs(span)) / step + 1e-7))
        for beam in range(first, last + 1):
            distance = cross / (normal_x * cosines[beam] + normal_y * sines[beam])
            if 0.0 < distance < nearest[beam]:
                nearest[beam] = distance
        turned -= 2.0 * math.pi
