"""Symmetric point-to-line registration of the walls of two maps."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.arrays import cleared
from tbmslam.kernels.grids.walls import WallPoints, Walls, facing_cosine, place_walls, wall_points


@part
def _pull(
    moving: WallPoints,
    fixed: Walls,
    pose: Pose,
    back: bool,
    centre: FloatArray,
    reach: float,
    facing: float,
    system: FloatArray,
) -> None:
    """Add the point-to-line equations of some moving walls to the upper half of the normal equations (4, 4).

    `pose` is T_target_source. With `back` the moving walls are those of the target.
    """
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    place_walls(moving, fixed, pose, back)
    # Each access to an array of a tuple counts its references, which takes longer than to read the array.
    points, normals, two_sided, weights = moving.points, moving.normals, moving.two_sided, moving.weights
    xs, ys, cells = moving.x, moving.y, moving.cells
    distances, nearest = fixed.distances.reshape(-1), fixed.nearest.reshape(-1)
    fixed_points, fixed_normals, fixed_two_sided = fixed.points, fixed.normals, fixed.two_sided
    # Local sums are faster than an array; this is the innermost loop of an alignment.
    xx, xy, xt, xd = system[0, 0], system[0, 1], system[0, 2], system[0, 3]
    yy, yt, yd = system[1, 1], system[1, 2], system[1, 3]
    tt, td = system[2, 2], system[2, 3]
    pulling, squares, number = system[3, 0], system[3, 1], system[3, 2]
    for i in range(len(cells)):
        cell = cells[i]
        if cell < 0 or distances[cell] > reach:
            continue
        mx, my = normals[i, 0], normals[i, 1]
        if back:
            ux, uy = cosine * mx + sine * my, -sine * mx + cosine * my
        else:
            ux, uy = cosine * mx - sine * my, sine * mx + cosine * my
        near = nearest[cell]
        nx, ny = fixed_normals[near, 0], fixed_normals[near, 1]
        if facing_cosine(ux, uy, nx, ny, two_sided[i] or fixed_two_sided[near]) < facing:
            continue
        x, y = xs[i], ys[i]
        distance = (x - fixed_points[near, 0]) * nx + (y - fixed_points[near, 1]) * ny
        if back:  # expressed in the target's frame
            x, y = points[i, 0], points[i, 1]
            nx, ny, distance = cosine * nx - sine * ny, sine * nx + cosine * ny, -distance
        weight = weights[i] / (1.0 + (distance / (0.5 * reach)) ** 2) ** 2
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
        # Scales of the damping: the sum of weights, and of squared distances from the centre.
        pulling += weights[i]
        squares += weights[i] * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2)
        number += 1.0
    system[0, 0], system[0, 1], system[0, 2], system[0, 3] = xx, xy, xt, xd
    system[1, 1], system[1, 2], system[1, 3] = yy, yt, yd
    system[2, 2], system[2, 3] = tt, td
    system[3, 0], system[3, 1], system[3, 2] = pulling, squares, number


@part
def _solved(system: FloatArray) -> Pose:
    """Return the solution of the normal equations: three columns, and the negative right-hand side."""
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
    """Refine motions T_target_source (M, 3) by point-to-line ICP in both directions (Chen, Medioni 1992; Censi 2008).

    Each reach (R,) is the largest distance of a match in one Gauss-Newton step [m]. Only walls whose normals have a
    cosine of at least `facing` match. The weight decreases with the distance (Geman-McClure), so that moved or
    distorted walls have little influence.
    """
    slid = motions.copy()
    middle = cleared(np.empty(2))
    for k in source_some:
        middle[0] += source.points[k, 0] / len(source_some)
        middle[1] += source.points[k, 1] / len(source_some)
    forth, back = wall_points(source, source_some), wall_points(target, target_some)
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
            _pull(forth, target, pose, False, centre, reach, facing, system)
            _pull(back, source, pose, True, centre, reach, facing, system)
            if system[3, 2] < 3.0:
                break
            # A corridor does not determine the translation along it. Small damping prevents large steps there.
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
