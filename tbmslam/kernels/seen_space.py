"""How far a laser saw in each direction, and what stands where it saw through."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, Pose, kernel


@kernel
def seen_distances(points: FloatArray, directions: int) -> FloatArray:
    """Return how far all is empty in each of some directions (D,) around the laser [m]; 0 where nothing came back.

    Parameters
    ----------
    points
        A scan's hits (M, 2) in the laser's frame [m].
    directions
        Number of sectors of the full circle, as `_sector` tells them; what the neighbours met counts, too.
    """
    nearest = np.full(directions, np.inf)
    for i in range(len(points)):
        sector = _sector(points[i, 0], points[i, 1], directions)
        nearest[sector] = min(nearest[sector], math.sqrt(points[i, 0] ** 2 + points[i, 1] ** 2))
    seen = np.zeros(directions)
    for k in range(directions):
        least = min(nearest[k - 1], nearest[k], nearest[(k + 1) % directions])
        most = max(nearest[k - 1], nearest[k], nearest[(k + 1) % directions])
        if math.isfinite(most):
            seen[k] = least
    return seen


@kernel
def stands_in_seen_space(
    points: FloatArray, pose: Pose, lasers: FloatArray, seen: FloatArray, depth: float
) -> npt.NDArray[np.bool_]:
    """Return which points (M,) lie where an earlier scan went on behind them.

    Parameters
    ----------
    points, pose
        Hits (M, 2) in the frame of a laser [m], and where that is.
    lasers, seen
        Poses (K, 3) of lasers and what `seen_distances` (K, D) says of their scans.
    depth
        How far the earlier scan went on [m].
    """
    count = len(points)
    stands = np.zeros(count, dtype=np.bool_)
    placed_x, placed_y, reach = np.empty(count), np.empty(count), np.empty(count)
    sector = np.empty(count, dtype=np.int32)
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    for i in range(count):
        placed_x[i] = pose[0] + cosine * points[i, 0] - sine * points[i, 1]
        placed_y[i] = pose[1] + sine * points[i, 0] + cosine * points[i, 1]
    for k in range(len(lasers)):
        turn_cosine, turn_sine = math.cos(lasers[k, 2]), math.sin(lasers[k, 2])
        # Apart from the look at what was seen, and without a branch, this compiles to a few wide instructions.
        for i in range(count):
            away_x, away_y = placed_x[i] - lasers[k, 0], placed_y[i] - lasers[k, 1]
            x, y = turn_cosine * away_x + turn_sine * away_y, turn_cosine * away_y - turn_sine * away_x
            sector[i] = _sector(x, y, seen.shape[1])
            reach[i] = math.sqrt(x * x + y * y) + depth
        for i in range(count):
            stands[i] |= seen[k, np.uint32(sector[i])] > reach[i]
    return stands


@kernel
def are_seen_through(
    points: FloatArray, around: FloatArray, lasers: FloatArray, seen: FloatArray, begins: IntArray, depth: float
) -> npt.NDArray[np.bool_]:
    """Return which points (M,) lie, with all that is around them, where one and the same scan went on behind them.

    Parameters
    ----------
    points
        Places (M, 2) [m].
    around
        What must be seen through, too, as seen from each of them (A, 2) [m].
    lasers
        Poses (K, 3) of lasers.
    seen, begins
        What `seen_distances` says of their scans, one after the other (S,), and where each begins (K + 1,).
    depth
        How far the scan went on [m].
    """
    through = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(lasers)):
        cosine, sine = math.cos(lasers[k, 2]), math.sin(lasers[k, 2])
        directions = begins[k + 1] - begins[k]
        for i in range(len(points)):
            j = len(around) if through[i] else 0
            while j < len(around):
                away_x, away_y = points[i, 0] + around[j, 0] - lasers[k, 0], points[i, 1] + around[j, 1] - lasers[k, 1]
                x, y = cosine * away_x + sine * away_y, cosine * away_y - sine * away_x
                if seen[begins[k] + _sector(x, y, directions)] <= math.sqrt(x * x + y * y) + depth:
                    break
                j += 1
            through[i] = j == len(around)
    return through


@kernel
def still_hits(
    points: FloatArray, normals: FloatArray, pose: Pose, lasers: FloatArray, seen: FloatArray, depth: float
) -> tuple[FloatArray, FloatArray]:
    """Return the points and normals (M, 2) that do not stand in seen space, as `stands_in_seen_space` tells it."""
    stands = stands_in_seen_space(points, pose, lasers, seen, depth)
    kept, facing = np.empty_like(points), np.empty_like(normals)
    count = 0
    for i in range(len(points)):
        kept[count, 0], kept[count, 1] = points[i, 0], points[i, 1]
        facing[count, 0], facing[count, 1] = normals[i, 0], normals[i, 1]
        count += int(not stands[i])
    return kept[:count], facing[:count]


@kernel
def _sector(x: float, y: float, directions: int) -> int:
    """Return the number of the sector that a direction lies in; they are equal to a twentieth.

    The arc tangent would take most of the time of all that is done here: z (pi / 4 + 0.273 (1 - |z|)) is as good.
    """
    width, height = abs(x), abs(y)
    is_steep = height > width
    larger, smaller = (height, width) if is_steep else (width, height)
    ratio = smaller / (larger + 1e-300)
    angle = ratio * (0.25 * math.pi + 0.273 * (1.0 - ratio))
    angle = 0.5 * math.pi - angle if is_steep else angle
    angle = math.pi - angle if x < 0.0 else angle
    angle = 2.0 * math.pi - angle if y < 0.0 else angle
    sector = np.int32(angle * (directions / (2.0 * math.pi)))
    return int(sector) if sector < directions else directions - 1
