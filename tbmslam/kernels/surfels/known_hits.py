"""The hits of a scan that lie on known surfaces."""

import math

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.surfels.outline import Outline, are_straight, share_on_outline
from tbmslam.kernels.surfels.surfels import SIDE, SurfelArrays, fit_surfel, layer_of, slot_of

_MATCHING = 0.9
"""A hit that matches a surfel by a larger share is not compared with the outline, which takes longer."""
_WIDTH = 0.1
"""Distance from the outline at which a hit counts half [m]. Scans 1.25 m apart are placed equally well with 0.15."""
_STRAIGHT = 0.01
"""A hit whose neighbours are far apart lies on a wall along the beams if it is this near to the line through them [m].
Errors of its range move it along the wall. With 0.05 a jamb and its wall are one line."""
_THIN = 0.03
"""Distance from the outline at which such a hit counts half [m]: an error of three milliradians at ten metres. With 0.1
door jambs lie on their wall, and drives along corridors follow reversed odometry."""
_ROUNDING = 1e-9
"""Distance of the laser from the line through a hit along a normal that points to it [m]."""


@kernel
def count_known_hits(
    surfels: SurfelArrays,
    points: FloatArray,
    normals: FloatArray,
    pose: Pose,
    span: float,
    tolerance: float,
    outline: Outline,
) -> tuple[float, float]:
    """Return the numbers of independent hits of a scan on known surfaces, and on none: strays.

    Known surfaces are surfels and the outline of the last keyframe.

    `surfels` are the fields of a `Surfels`. The hits (N, 2) [m], in the order of the beams, and the normals (N, 2) of
    the surfaces are in the scan's frame, whose pose in the map is `pose`. Hits within a length `span` of surface count
    as one [m]. At the distance `tolerance` from a surfel a hit counts half [standard deviations].
    """
    tiles, _, fits, (resolution, first_row, first_col), _ = surfels
    rows, cols, inverse = float(tiles.shape[1] * SIDE), float(tiles.shape[2] * SIDE), 1.0 / resolution
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    squared, before, per_span = tolerance * tolerance, 0.5, 0.5 / span
    on_known, strays = 0.0, 0.0
    for i in range(len(points)):
        px, py, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
        after = 0.5
        if i + 1 < len(points):
            dx, dy = points[i + 1, 0] - px, points[i + 1, 1] - py
            after = min(per_span * math.sqrt(dx * dx + dy * dy), 0.5)
        counted, before, known = before + after, after, 0.0
        hit_x, hit_y = x + cosine * px - sine * py, y + sine * px + cosine * py
        normal_x, normal_y = cosine * nx - sine * ny, sine * nx + cosine * ny
        cell_x, cell_y = hit_x * inverse - first_col, hit_y * inverse - first_row
        if 0.0 <= cell_x < cols and 0.0 <= cell_y < rows:
            layer = layer_of(normal_x, normal_y)
            slot = slot_of(tiles, layer, int(cell_y), int(cell_x))
            if fits[slot, 5] < 0.0:
                fit_surfel(surfels, layer, int(cell_y), int(cell_x))
            dx, dy = hit_x - fits[slot, 0], hit_y - fits[slot, 1]
            distance = fits[slot, 2] * dx * dx + 2.0 * fits[slot, 3] * dx * dy + fits[slot, 4] * dy * dy
            known = fits[slot, 5] * squared / (squared + distance)
        if known < _MATCHING:
            nx, ny, width = _surface_of(points, normals, i)
            normal_x, normal_y = cosine * nx - sine * ny, sine * nx + cosine * ny
            known = max(known, share_on_outline(outline, hit_x, hit_y, normal_x, normal_y, width))
        on_known += counted * known
        strays += counted * (1.0 - known)
    return on_known, strays


@part
def _surface_of(points: FloatArray, normals: FloatArray, hit: int) -> tuple[float, float, float]:
    """Return the normal of a hit's surface and the distance from an outline at which the hit counts half [m].

    Where the neighbours of a hit are far apart, as on walls along the beams, `write_normals` writes the direction to
    the laser. There the hit has a surface if it is on a line with its neighbours.
    """
    x, y, normal_x, normal_y = points[hit, 0], points[hit, 1], normals[hit, 0], normals[hit, 1]
    is_estimated = abs(x * normal_y - y * normal_x) > _ROUNDING
    if is_estimated or not 0 < hit < len(points) - 1 or not are_straight(points, hit, _STRAIGHT):
        return normal_x, normal_y, _WIDTH
    normal_x, normal_y = points[hit - 1, 1] - points[hit + 1, 1], points[hit + 1, 0] - points[hit - 1, 0]
    length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
    if normal_x * x + normal_y * y > 0.0:
        length = -length
    return normal_x / length, normal_y / length, _THIN
