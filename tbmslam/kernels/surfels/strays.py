"""Hits of a scan that match no surface, and how many of them lie in space that an earlier scan saw free."""

import math

from tbmslam.kernels import FloatArray, Pose, kernel
from tbmslam.kernels.surfels.surfels import SIDE, SurfelArrays, fit_surfel, layer_of, slot_of

View = tuple[FloatArray, float, float, Pose]
"""Ranges (N,) of a scan [m], direction of its first beam, step between beams [rad], and its pose in the map's frame."""

_MARGIN = 0.1
"""A hit lies in free space if the beams around it went on by more, and if it is farther from the outline between their
ends [m]: beams go on by metres beside a hit on a wall that they meet at a small angle. Scans 1 m apart in csail are
placed right with 0.05 and 0.1, and wrong with 0.3."""

_AROUND = 3
"""Number of beams to each side of a hit whose ends may be the outline there."""

_MATCHING = 0.9
"""A hit that matches a surfel by a larger share does not lie in free space."""


@kernel
def count_strays(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    pose: Pose,
    span: float,
    tolerance: float,
    view: View,
) -> tuple[float, float]:
    """Return the number of independent hits of a scan that match no surfel, and how many of them lie in free space.

    `surfels` are the fields of a `Surfels`. The hits (N, 2) [m], in the order of the beams, and the normals (N, 2) of
    the surfaces are in the scan's frame, whose pose in the map is `pose`. Hits within a length `span` of surface count
    as one [m]. At the distance `tolerance` from a surfel a hit counts half [standard deviations]. The beams of the
    earlier scan `view` passed through free space.
    """
    tiles, _, fits, (resolution, first_row, first_col), _ = surfels
    rows, cols, inverse = float(tiles.shape[1] * SIDE), float(tiles.shape[2] * SIDE), 1.0 / resolution
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    squared, strays, in_free_space, before, per_span = tolerance * tolerance, 0.0, 0.0, 0.5, 0.5 / span
    for i in range(len(points)):
        px, py, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
        after = 0.5
        if i + 1 < len(points):
            dx, dy = points[i + 1, 0] - px, points[i + 1, 1] - py
            after = min(per_span * math.sqrt(dx * dx + dy * dy), 0.5)
        counted, before, known = before + after, after, 0.0
        hit_x, hit_y = x + cosine * px - sine * py, y + sine * px + cosine * py
        cell_x, cell_y = hit_x * inverse - first_col, hit_y * inverse - first_row
        if 0.0 <= cell_x < cols and 0.0 <= cell_y < rows:
            layer = layer_of(cosine * nx - sine * ny, sine * nx + cosine * ny)
            slot = slot_of(tiles, layer, int(cell_y), int(cell_x))
            if fits[slot, 5] < 0.0:
                fit_surfel(surfels, layer, int(cell_y), int(cell_x))
            dx, dy = hit_x - fits[slot, 0], hit_y - fits[slot, 1]
            distance = fits[slot, 2] * dx * dx + 2.0 * fits[slot, 3] * dx * dy + fits[slot, 4] * dy * dy
            known = fits[slot, 5] * squared / (squared + distance)
        strays += counted * (1.0 - known)
        # Most hits match, so their direction need not be computed.
        if known < _MATCHING and _saw_free(view, hit_x, hit_y):
            in_free_space += counted * (1.0 - known)
    return strays, in_free_space


@kernel
def _saw_free(view: View, x: float, y: float) -> bool:
    """Return whether a place in the map's frame [m] lies before the outline that a view shows, and not near it."""
    ranges, angle_min, step, (origin_x, origin_y, heading) = view
    dx, dy = x - origin_x, y - origin_y
    # From the first beam on, in the direction in which the laser turns.
    turned = math.copysign(1.0, step) * (math.atan2(dy, dx) - heading - angle_min)
    step = abs(step)
    place = (turned / step + 0.5) % (2.0 * math.pi / step) - 0.5
    beam, far = int(place + 0.5), math.sqrt(dx * dx + dy * dy)
    if not 0 < beam < len(ranges) - 1:
        return False
    before, there, after = ranges[beam - 1], ranges[beam], ranges[beam + 1]
    # A sum with a beam that hit nothing, or is unknown, is not below infinity.
    if not (before + there + after < math.inf and far + _MARGIN < min(before, there, after)):
        return False
    for k in range(max(beam - _AROUND, 0), min(beam + _AROUND, len(ranges) - 1)):
        if _distance_from_segment(ranges[k], ranges[k + 1], step, (k - place) * step, far) < _MARGIN:
            return False
    return True


@kernel
def _distance_from_segment(first: float, second: float, step: float, angle: float, far: float) -> float:
    """Return the distance of a place from the segment between the ends of two beams [m]; inf if one is unknown.

    The ranges are those of the two beams [m], `step` is the angle between them, and `angle` that from the place to the
    first beam [rad]. The place is at the distance `far` from the laser [m].
    """
    if not 0.0 < first + second < math.inf:
        return math.inf
    # With the place as the origin, and the direction to it as the first axis.
    x, y = first * math.cos(angle) - far, first * math.sin(angle)
    along_x, along_y = second * math.cos(angle + step) - far - x, second * math.sin(angle + step) - y
    share = min(max(-(x * along_x + y * along_y) / (along_x * along_x + along_y * along_y), 0.0), 1.0)
    return math.hypot(x + share * along_x, y + share * along_y)
