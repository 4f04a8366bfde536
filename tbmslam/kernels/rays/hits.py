"""Hits of scans and the normals of the surfaces that were hit."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.arrays import cleared


@kernel
def any_negative(ranges: FloatArray) -> bool:
    """Return whether any range (N,) is negative; not-a-number does not count."""
    found = False
    for i in range(len(ranges)):
        found |= ranges[i] < 0.0
    return found


@kernel
def hit_points(
    ranges: FloatArray, angle_min: float, angle_increment: float, beam_step: Pose, max_range: float
) -> FloatArray:
    """Return the end points (M, 2) [m] of the finite ranges (N,) up to `max_range`, in the order of the beams.

    `beam_step` is the motion of the laser from one beam to the next. The points are in its frame at the first beam.
    """
    points = np.empty((len(ranges), 2))
    return points[: _write_points(ranges, angle_min, angle_increment, beam_step, max_range, points)]


@part
def _write_points(
    ranges: FloatArray,
    angle_min: float,
    angle_increment: float,
    beam_step: Pose,
    max_range: float,
    points: FloatArray,
) -> int:
    """Write the result of `hit_points` into the first of points (N, 2), and return its size."""
    x, y, count = 0.0, 0.0, 0
    still = beam_step[0] == 0.0 and beam_step[1] == 0.0
    # Rotating the direction from beam to beam takes a fifth of the time of computing sines.
    cosine, sine = math.cos(angle_min), math.sin(angle_min)
    turn_cosine, turn_sine = math.cos(angle_increment + beam_step[2]), math.sin(angle_increment + beam_step[2])
    step_x, step_y = beam_step[0], beam_step[1]
    sway_cosine, sway_sine = math.cos(beam_step[2]), math.sin(beam_step[2])
    for i in range(len(ranges)):
        distance = float(ranges[i])
        if distance <= max_range and math.isfinite(distance):
            points[count, 0], points[count, 1] = x + distance * cosine, y + distance * sine
            count += 1
        cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
        if not still:
            x, y = x + step_x, y + step_y
            step_x, step_y = step_x * sway_cosine - step_y * sway_sine, step_y * sway_cosine + step_x * sway_sine
    return count


@part
def write_normals(points: FloatArray, apart: int, longest: float, normals: FloatArray) -> None:
    """Write unit normals (M, 2), towards the origin, of the surfaces of points (M, 2) in beam order.

    A normal is perpendicular to the line between the neighbours `apart` indices before and after. If that line is
    longer than `longest` [m], or a point, the neighbours belong to another surface, and the normal points to the
    origin.
    """
    last = len(points) - 1
    for i in range(len(points)):
        before, after = max(i - apart, 0), min(i + apart, last)
        dx, dy = points[after, 0] - points[before, 0], points[after, 1] - points[before, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > longest or length < 1e-6:
            nx, ny = -points[i, 0], -points[i, 1]
            length = max(math.sqrt(nx * nx + ny * ny), 1e-12)
        else:
            nx, ny = -dy, dx
            if nx * points[i, 0] + ny * points[i, 1] > 0.0:
                nx, ny = dy, -dx
        normals[i, 0], normals[i, 1] = nx / length, ny / length


@kernel
def hits_of_scan(
    ranges: FloatArray,
    angle_min: float,
    angle_increment: float,
    beam_step: Pose,
    max_range: float,
) -> tuple[FloatArray, FloatArray]:
    """Return `hit_points` and their normals, see `write_normals`."""
    points, normals = np.empty((len(ranges), 2)), np.empty((len(ranges), 2))
    count = write_hits(ranges, angle_min, angle_increment, beam_step, max_range, points, normals)
    return points[:count], normals[:count]


@part
def write_hits(
    ranges: FloatArray,
    angle_min: float,
    angle_increment: float,
    beam_step: Pose,
    max_range: float,
    points: FloatArray,
    normals: FloatArray,
) -> int:
    """Write the result of `hits_of_scan` into the first of points and normals (N, 2), and return its size.

    Neighbouring hits of dense beams are nearer than their noise, so more distant neighbours give better normals.
    """
    count = _write_points(ranges, angle_min, angle_increment, beam_step, max_range, points)
    write_normals(points[:count], max(len(ranges) // 180, 1), 0.5, normals)
    return count


@kernel
def hits_of_scans(
    ranges: npt.NDArray[np.float32],
    offsets: npt.NDArray[np.int64],
    beams: FloatArray,
    beam_steps: FloatArray,
    max_range: float,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Return the hits (P, 2) of many scans, their normals (P, 2), and the first index of each scan (K + 1,).

    The scans are given as in `tbmslam.map.keyframes.Keyframes`. Single precision keeps errors near a micrometre.
    """
    begins, longest = cleared(np.empty(len(offsets), dtype=np.int64)), 0
    for k in range(len(beams)):
        count = 0
        for i in range(offsets[k], offsets[k + 1]):
            count += ranges[i] <= max_range and math.isfinite(ranges[i])
        begins[k + 1], longest = begins[k] + count, max(longest, offsets[k + 1] - offsets[k])
    points, normals = np.empty((begins[-1], 2), dtype=np.float32), np.empty((begins[-1], 2), dtype=np.float32)
    wide = np.empty(longest)
    for k in range(len(beams)):
        step = (beam_steps[k, 0], beam_steps[k, 1], beam_steps[k, 2])
        for i in range(offsets[k], offsets[k + 1]):
            wide[i - offsets[k]] = ranges[i]
        own, facing = hits_of_scan(wide[: offsets[k + 1] - offsets[k]], beams[k, 0], beams[k, 1], step, max_range)
        # Element by element, since assigning an array to a slice takes seconds to compile.
        for i in range(len(own)):
            for axis in range(2):
                points[begins[k] + i, axis], normals[begins[k] + i, axis] = own[i, axis], facing[i, axis]
    return points, normals, begins


@kernel
def place_hits(
    points: npt.NDArray[np.float32],
    normals: npt.NDArray[np.float32],
    offsets: npt.NDArray[np.int64],
    chosen: npt.NDArray[np.int64],
    poses: FloatArray,
    frame: int,
    at_least: int,
) -> tuple[FloatArray, FloatArray]:
    """Return hits of chosen scans and their normals, (M, 2) each, in the frame of one sensor.

    `points` and `normals` (P, 2) are those of all scans in the sensor's frame, and `offsets` (K + 1,) the first index
    of each scan and the end of the last scan. `poses` (K, 3) are those of the sensor, and `frame` is the index of the
    scan whose frame is used for the result. Only every n-th hit is returned, with n = max(size // at_least, 1), so that
    `at_least` or more remain if there are as many.
    """
    total = 0
    for k in chosen:
        total += offsets[k + 1] - offsets[k]
    step = max(total // at_least, 1)
    placed, facing = np.empty((-(-total // step), 2)), np.empty((-(-total // step), 2))
    fx, fy, heading = poses[frame, 0], poses[frame, 1], poses[frame, 2]
    fc, fs = math.cos(heading), math.sin(heading)
    count, skipped = 0, 0
    for k in chosen:
        cosine, sine = math.cos(poses[k, 2] - heading), math.sin(poses[k, 2] - heading)
        dx, dy = poses[k, 0] - fx, poses[k, 1] - fy
        x, y = fc * dx + fs * dy, fc * dy - fs * dx
        i = offsets[k] + skipped
        while i < offsets[k + 1]:
            px, py, nx, ny = float(points[i, 0]), float(points[i, 1]), float(normals[i, 0]), float(normals[i, 1])
            placed[count, 0], placed[count, 1] = x + cosine * px - sine * py, y + sine * px + cosine * py
            facing[count, 0], facing[count, 1] = cosine * nx - sine * ny, sine * nx + cosine * ny
            count += 1
            i += step
        skipped = i - offsets[k + 1]
    return placed, facing
