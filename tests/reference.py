"""Slow, plain twins of the kernels, written for reading."""

import functools
import math

import numpy as np

from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN, VACUOUS
from tbmslam.kernels.surfels.surfel_alignment import pair_up
from tests.belief_rules import conjunctive, dempster, normalise


def is_inside(geometry, row, col):
    """Return whether a cell lies in a grid."""
    return 0 <= row < geometry.rows and 0 <= col < geometry.cols


def observation(probability, quality):
    """Masses of one beam's word on a cell."""
    return np.array([0.0, (1 - probability) * quality, probability * quality, 1 - quality])


def insert_beams(cells, resolution, start, ends, is_hit, model, quality):
    """Combine beams into a dict of cells (row, col) -> masses by Dempster's rule, as vinySLAM does."""
    radius = model.wall_blur / resolution
    for end, hit in zip(ends, is_hit, strict=True):
        path = walk(start, end, resolution)
        goal = path[-1]
        span = squared_distance(path[0], goal)
        for cell in path:
            gap = squared_distance(cell, goal)
            if cell == goal and hit:
                word = observation(model.hit_probability, model.hit_quality * quality)
            elif hit and gap < radius**2 < span:
                blurred = model.hit_probability * (1 - gap / radius**2)
                word = observation(blurred, model.miss_quality * quality)
            else:
                word = observation(model.miss_probability, model.miss_quality * quality)
            cells[cell] = dempster(cells.get(cell, VACUOUS), word)


def insert_beams_as_means(cells, resolution, start, ends, is_hit, model, quality):
    """Collect the probabilities that beams give to cells, in a dict (row, col) -> list, as tinySLAM does."""
    radius = model.wall_blur / resolution
    for end, hit in zip(ends, is_hit, strict=True):
        path = walk(start, end, resolution)
        for cell in path:
            gap = squared_distance(cell, path[-1])
            probability = model.miss_probability
            if hit and cell == path[-1]:
                probability = model.hit_probability
            elif hit and gap < radius**2 < squared_distance(path[0], path[-1]):
                probability = model.hit_probability * (1 - gap / radius**2)
            cells.setdefault(cell, []).append(0.5 + (probability - 0.5) * quality)


def insert_scan(cells, resolution, start, ends, is_hit, model, quality):
    """Combine a scan into a dict of cells, one word for each cell, hits first."""
    hits, passed = cells_of_scan(start, ends, is_hit, resolution)
    for chosen, probability, mass in (
        (hits, model.hit_probability, model.hit_quality),
        (passed, model.miss_probability, model.miss_quality),
    ):
        before = np.array([cells.get(cell, VACUOUS) for cell in chosen]).reshape(-1, 4)
        cells.update(zip(chosen, conjunctive(before, observation(probability, mass * quality)), strict=True))


def cells_of_scan(start, ends, is_hit, resolution):
    """Return the cells that a scan hits, and those that it passes without hitting them."""
    paths = [walk(start, end, resolution) for end in ends]
    hits = {path[-1] for path, hit in zip(paths, is_hit, strict=True) if hit}
    return hits, {cell for path in paths for cell in path} - hits


def repeated(model, hits, passed, keeps_conflict):
    """Masses of a cell that was hit and passed some number of times."""
    observations = [observation(model.hit_probability, model.hit_quality)] * hits
    observations += [observation(model.miss_probability, model.miss_quality)] * passed
    if not keeps_conflict:
        return functools.reduce(dempster, observations, VACUOUS)
    # What all of them have for free, and what they have for occupied, as two sources.
    ignorance = {
        side: math.prod(o[UNKNOWN] / (o[side] + o[UNKNOWN]) for o in observations) for side in (FREE, OCCUPIED)
    }
    for_free = np.array([0.0, 1 - ignorance[FREE], 0.0, ignorance[FREE]])
    for_occupied = np.array([0.0, 0.0, 1 - ignorance[OCCUPIED], ignorance[OCCUPIED]])
    return conjunctive(for_free, for_occupied)


def squared_distance(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2


def walk(start, end, resolution):
    """Return the (row, col) cells of a 4-connected walk along a beam."""
    (x0, y0), (x1, y1) = start, end
    cell = (math.floor(y0 / resolution), math.floor(x0 / resolution))
    goal = (math.floor(y1 / resolution), math.floor(x1 / resolution))
    dx, dy = x1 - x0, y1 - y0
    row_step, col_step = (1 if dy > 0 else -1), (1 if dx > 0 else -1)

    def height_error(row, col):
        return dx * (y0 - (row + 0.5) * resolution) + dy * ((col + 0.5) * resolution - x0)

    path, correction = [cell], 0.0
    while cell != goal:
        row, col = cell
        by_row = abs(height_error(row + row_step, col) + correction)
        by_col = abs(height_error(row, col + col_step) + correction)
        if abs(by_row - by_col) <= 1e-7 * max(1.0, by_row, by_col):
            cell = (row + (row_step if row != goal[0] else 0), col + (col_step if col != goal[1] else 0))
            correction = -height_error(*cell)
        elif by_row < by_col:
            cell = (row + row_step, col)
        else:
            cell = (row, col + col_step)
        path.append(cell)
        if len(path) > abs(goal[0] - path[0][0]) + abs(goal[1] - path[0][1]) + 1:
            return bresenham(path[0], goal)
    return path


def bresenham(cell, goal):
    row, col = cell
    rows, cols = abs(goal[0] - row), abs(goal[1] - col)
    path, error = [cell], cols - rows
    while (row, col) != goal:
        doubled = 2 * error
        if doubled > -rows:
            error -= rows
            col += 1 if goal[1] > col else -1
        if doubled < cols:
            error += cols
            row += 1 if goal[0] > row else -1
        path.append((row, col))
    return path


def impact(masses):
    """Agreement of a cell with a certain hit, in vinySLAM's general form."""
    hit = np.array([0.0, 0.0, 1.0, 0.0])
    ignorance = (masses[UNKNOWN] + hit[UNKNOWN]) / 2
    conflict = masses[FREE] * hit[OCCUPIED] + masses[OCCUPIED] * hit[FREE]
    difference = abs(hit[OCCUPIED] - masses[OCCUPIED])
    return 1 - (ignorance / 2 + (1 - ignorance) * (conflict + difference) / 2)


def weighted_impact(masses_at, resolution, points, weights, pose):
    """Weighted mean agreement of a scan at a pose; `masses_at` maps (row, col) to masses."""
    x, y, theta = pose
    total = 0.0
    for (px, py), weight in zip(points, weights, strict=True):
        wx = x + math.cos(theta) * px - math.sin(theta) * py
        wy = y + math.sin(theta) * px + math.cos(theta) * py
        cell = (math.floor(wy / resolution), math.floor(wx / resolution))
        total += weight * impact(normalise(masses_at.get(cell, VACUOUS)))
    return total


def climb_hill(score, pose, length, angle, halvings):
    """Climb on `score(pose)` along the axes."""
    best, best_score, failures = np.array(pose, dtype=float), score(pose), 0
    while failures < halvings:
        base, improved = best.copy(), False
        for offset in ((length, 0, 0), (0, -length, 0), (0, 0, angle), (-length, 0, 0), (0, length, 0), (0, 0, -angle)):
            trial = base + offset
            if score(trial) > best_score:
                best, best_score, improved = trial, score(trial), True
        if not improved:
            failures += 1
            length, angle = length / 2, angle / 2
    return best, best_score


def surfel(points, cell, resolution, noise, point_size, clutter, certain_count):
    """Fit mean, information matrix and weight to the points in a cell and its neighbours; None where too few."""
    rows_cols = np.floor(points[:, ::-1] / resolution).astype(int)
    near = points[np.abs(rows_cols - cell).max(axis=1) <= 1]
    if len(near) < 3:
        return None
    mean = near.mean(axis=0)
    covariance = (near - mean).T @ (near - mean) / len(near)
    variances, axes = np.linalg.eigh(covariance)
    across = 1 / (max(variances[0], 0) + noise**2)
    along = 1 / (variances[1] + noise**2) if variances[1] < point_size**2 else 0.0
    information = across * np.outer(axes[:, 0], axes[:, 0]) + along * np.outer(axes[:, 1], axes[:, 1])
    weight = min(len(near) / certain_count, 1.0) / (1 + max(variances[0], 0) / clutter**2)
    return mean, information, weight


def facing_normals(points, apart, longest):
    """Turn the line between neighbours by a quarter and let it face the origin."""
    normals = []
    for i, point in enumerate(points):
        line = points[min(i + apart, len(points) - 1)] - points[max(i - apart, 0)]
        normal = np.array([-line[1], line[0]])
        if not 1e-6 <= np.linalg.norm(line) <= longest:
            normal = -point
        normal = normal / np.linalg.norm(normal)
        normals.append(-normal if normal @ point > 0 else normal)
    return np.array(normals)


def laser_motion(heading, mount):
    """How the laser moves in the map's frame (3, 3) as the robot moves along, across and turns."""
    cosine, sine = math.cos(heading), math.sin(heading)
    lever = np.array([[cosine, -sine], [sine, cosine]]) @ np.array(mount[:2])
    return np.array([[cosine, -sine, -lever[1]], [sine, cosine, lever[0]], [0.0, 0.0, 1.0]])


def prior_information(deviations, heading, mount):
    """Information of the laser's pose: the inverse of the robot's covariance carried to the laser."""
    motion = laser_motion(heading, mount)
    back = np.linalg.inv(motion)
    return back.T @ np.diag(1.0 / np.array(deviations) ** 2) @ back


def seen_by_robot(information, heading, mount):
    """Information of the robot's pose in its own frame from that of the laser's pose in the map's."""
    motion = laser_motion(heading, mount)
    return motion.T @ information @ motion


def robust_cost(pairs, pose, tolerance):
    """Sum of Geman and McClure's cost of pairs (8, M) of `surfel_alignment.pair_up`."""
    x, y, theta = pose
    cosine, sine = np.cos(theta), np.sin(theta)
    placed = np.column_stack((x + cosine * pairs[0] - sine * pairs[1], y + sine * pairs[0] + cosine * pairs[1]))
    total = 0.0
    for (dx, dy), (xx, xy, yy), weight in zip(placed - pairs[2:4].T, pairs[4:7].T, pairs[7], strict=True):
        squared = xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy
        total += weight * tolerance**2 * squared / (tolerance**2 + squared)
    return total


def normal_equations(pairs, pose, tolerance):
    """Matched hits, Hessian and gradient of pairs (8, M), one after the other."""
    x, y, theta = pose
    rotation = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    matched, hessian, gradient = 0.0, np.zeros((3, 3)), np.zeros(3)
    for pair in pairs.T:
        turned = rotation @ pair[:2]
        error = turned + np.array([x, y]) - pair[2:4]
        information = np.array([[pair[4], pair[5]], [pair[5], pair[6]]])
        jacobian = np.array([[1.0, 0.0, -turned[1]], [0.0, 1.0, turned[0]]])
        influence = tolerance**2 / (tolerance**2 + error @ information @ error)
        matched += pair[7] * influence
        hessian += pair[7] * influence**2 * jacobian.T @ information @ jacobian
        gradient += pair[7] * influence**2 * jacobian.T @ information @ error
    return matched, hessian, gradient


def matched_share(surfels, points, normals, pose, tolerance):
    """Share of points that lie on surfels, each counting alike, as `surfel_search.search` has it."""
    pairs = np.empty((8, len(points) + 1))
    total = 0.0
    for k in range(len(points)):  # one at a time, so that no hit has a neighbour
        one = slice(k, k + 1)
        count, _ = pair_up(surfels, points[one], normals[one], 1, 1.0, pose, pairs)
        if count:
            total += normal_equations(pairs[:, :1], pose, tolerance)[0]
    return total / len(points)


def ranges_in_box(pose, angles, half_width, half_height):
    """Return the ranges that a laser at a pose in a box about the origin sees in some directions."""
    directions = pose[2] + angles
    with np.errstate(divide="ignore"):
        across = np.where(np.cos(directions) > 0, half_width - pose[0], -half_width - pose[0]) / np.cos(directions)
        along = np.where(np.sin(directions) > 0, half_height - pose[1], -half_height - pose[1]) / np.sin(directions)
    return np.minimum(across, along)


def is_straight(ends, middle):
    """Return whether an end is within 5 cm of the line through its two neighbours."""
    if not 0 < middle < len(ends) - 1 or not np.isfinite(ends[middle - 1 : middle + 2]).all():
        return False
    first, place, last = ends[middle - 1 : middle + 2]
    along = (last - first) / np.hypot(*(last - first))
    away = place - first
    return bool(np.hypot(*(away - (away @ along) * along)) < 0.05)


def share_on_outline(ranges, first, step, pose, place, normal):
    """Return the weight with which a hit lies between the ends of neighbouring beams that lie on one line with a third.

    Only surfaces of the three beams to each side count, and only if their normals differ by less than acos(0.8).
    """
    directions = pose[2] + first + step * np.arange(len(ranges))
    ends = np.array(pose[:2]) + ranges[:, None] * np.column_stack((np.cos(directions), np.sin(directions)))
    away = np.asarray(place) - pose[:2]
    bearing = math.atan2(away[1], away[0])
    apart = np.abs((directions - bearing + np.pi) % (2.0 * np.pi) - np.pi)
    beam, nearest = int(apart.argmin()), math.inf
    for k in range(max(beam - 3, 0), min(beam + 3, len(ranges) - 1)):
        along = ends[k + 1] - ends[k]
        length = math.hypot(*along)
        if not any(is_straight(ends, i) for i in (k, k + 1)):
            continue
        square = np.array([-along[1], along[0]]) / length
        square *= math.copysign(1.0, square @ (pose[:2] - ends[k]))
        if square @ normal < 0.8:
            continue
        on_segment = ends[k] + np.linspace(0.0, 1.0, 2001)[:, None] * along
        nearest = min(nearest, np.hypot(*(on_segment - place).T).min())
    return 0.01 / (0.01 + nearest**2)
