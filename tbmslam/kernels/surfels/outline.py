"""The outline of a scan: the surfaces between the ends of neighbouring beams.

A surfel needs several hits within a few cells. Far from the laser the ends of beams lie farther apart, so that a
surface that one scan showed there has no surfel yet. The outline holds it.
"""

import math

import numpy as np

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.arrays import cleared

Outline = tuple[FloatArray, float, float, Pose]
"""Surfaces (beams - 1, 5) in the map's frame, the direction of the first beam, the step between beams [rad], and the
pose of the scan in the map's frame. A surface is given by x and y of one end [m], the direction (2,) of the other end,
with the laser to its left, and its length [m]. The direction is zero where there is no surface."""

_STRAIGHT = 0.05
"""Three neighbouring ends lie on one surface if the middle one is nearer to the line through the other two [m]. So a
wall that the beams meet at a small angle is a surface, and the space between two objects is none."""
_AROUND = 3
"""Number of surfaces to each side of a hit's direction that may be the nearest one."""
_SAME = 0.8
"""Smallest cosine of the angle between the normal of a hit and that of the surface on which it lies. Without it, door
jambs would lie on the outline of their wall, and drives along corridors follow reversed odometry."""


@kernel
def outline_of(ranges: FloatArray, angle_min: float, step: float, pose: Pose) -> FloatArray:
    """Return the surfaces (N - 1, 5) of the outline of a scan with N ranges [m]; see `Outline`."""
    x, y, theta = pose
    ends, surfaces = np.empty((len(ranges), 2)), cleared(np.empty((max(len(ranges) - 1, 0), 5)))
    for i in range(len(ranges)):
        if ranges[i] < math.inf:
            angle = theta + angle_min + i * step
            ends[i, 0], ends[i, 1] = x + ranges[i] * math.cos(angle), y + ranges[i] * math.sin(angle)
    was_straight = False
    for i in range(len(surfaces)):
        # A sum with a beam that hit nothing, or is unknown, is not below infinity.
        is_known = i + 2 < len(ranges) and ranges[i] + ranges[i + 1] + ranges[i + 2] < math.inf
        is_straight = is_known and are_straight(ends, i + 1, _STRAIGHT)
        if was_straight or is_straight:
            first, last = (i, i + 1) if step > 0.0 else (i + 1, i)
            surfaces[i, 0], surfaces[i, 1] = ends[first, 0], ends[first, 1]
            along_x, along_y = ends[last, 0] - ends[first, 0], ends[last, 1] - ends[first, 1]
            length = math.sqrt(along_x * along_x + along_y * along_y)
            if length > 0.0:
                surfaces[i, 2], surfaces[i, 3], surfaces[i, 4] = along_x / length, along_y / length, length
        was_straight = is_straight
    return surfaces


@part
def are_straight(ends: FloatArray, middle: int, tolerance: float) -> bool:
    """Return whether one of the ends (N, 2) of beams is within a tolerance of the line through its neighbours [m]."""
    x, y = ends[middle - 1, 0], ends[middle - 1, 1]
    along_x, along_y = ends[middle + 1, 0] - x, ends[middle + 1, 1] - y
    area = along_x * (ends[middle, 1] - y) - along_y * (ends[middle, 0] - x)
    return bool(area * area < tolerance * tolerance * (along_x * along_x + along_y * along_y))


@part
def share_on_outline(outline: Outline, x: float, y: float, normal_x: float, normal_y: float, width: float) -> float:
    """Return the weight in [0, 1] with which a hit lies on an outline.

    The hit's place [m] and the normal of its surface, towards its laser, are in the map's frame. At the distance
    `width` from a surface it counts half [m].
    """
    surfaces, angle_min, step, (origin_x, origin_y, heading) = outline
    # From the first beam on, in the direction in which the laser turns.
    around = 2.0 * math.pi / abs(step)
    turned = (math.atan2(y - origin_y, x - origin_x) - heading - angle_min) / step + 0.5
    beam = int(turned - around * math.floor(turned / around))  # not by %, which takes longer
    nearest = math.inf
    for i in range(max(beam - _AROUND, 0), min(beam + _AROUND, len(surfaces))):
        along_x, along_y, length = surfaces[i, 2], surfaces[i, 3], surfaces[i, 4]
        dx, dy = x - surfaces[i, 0], y - surfaces[i, 1]
        along, across = dx * along_x + dy * along_y, dx * along_y - dy * along_x
        beyond = along - min(max(along, 0.0), length)
        squared = beyond * beyond + across * across
        # Without a branch, which would often be mispredicted.
        nearest = min(nearest, squared if normal_y * along_x - normal_x * along_y >= _SAME else math.inf)
    return width * width / (width * width + nearest)
