"""Agreement of a scan with a grid of evidence, and the pose searches of the original vinySLAM."""

import math

from tbmslam.kernels import FloatArray, Pose, kernel, part
from tbmslam.kernels.rays.lattice import Lattice


@part
def impact_at(ratios: FloatArray, row: int, col: int, disjunctive: bool = False) -> float:
    """Return the agreement of a cell with a certain hit, in [0, 1].

    For masses u, f, o it is 1 - (u/4 + (1 - u/2) (f + 1 - o)/2) (vinySLAM). This combines the ignorance with the
    conflict and the difference that a certain hit would cause in the cell. It is 0.5 in unknown cells. With
    `disjunctive` it is o, the mass on OCCUPIED by the disjunctive rule, and 0 in unknown cells.
    """
    if row < 0 or col < 0 or row >= ratios.shape[0] or col >= ratios.shape[1]:
        return 0.0 if disjunctive else 0.5
    free_ratio, occupied_ratio = float(ratios[row, col, 0]), float(ratios[row, col, 1])
    unknown = 1.0 / (free_ratio + occupied_ratio - 1.0)
    free, occupied = (free_ratio - 1.0) * unknown, (occupied_ratio - 1.0) * unknown
    if disjunctive:
        return occupied
    return 1.0 - (0.25 * unknown + (1.0 - 0.5 * unknown) * 0.5 * (free + 1.0 - occupied))


@kernel
def weighted_impact(
    ratios: FloatArray,
    lattice: Lattice,
    points: FloatArray,
    weights: FloatArray,
    pose: Pose,
    disjunctive: bool = False,
) -> float:
    """Return the weighted sum of `impact_at` over points (N, 2) [m], transformed by the pose of their frame."""
    resolution, first_row, first_col = lattice
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    total = 0.0
    for i in range(len(points)):
        px, py = points[i, 0], points[i, 1]
        col = math.floor((x + cosine * px - sine * py) / resolution) - first_col
        row = math.floor((y + sine * px + cosine * py) / resolution) - first_row
        total += weights[i] * impact_at(ratios, row, col, disjunctive)
    return total


@kernel
def search_monte_carlo(
    ratios: FloatArray,
    lattice: Lattice,
    points: FloatArray,
    weights: FloatArray,
    pose: Pose,
    best_score: float,
    offsets: FloatArray,
    disjunctive: bool = False,
) -> tuple[int, float]:
    """Return the index of the first of `pose` + `offsets` (K, 3) with a better score, and this score; -1 if none."""
    x, y, theta = pose
    for k in range(len(offsets)):
        candidate = (x + offsets[k, 0], y + offsets[k, 1], theta + offsets[k, 2])
        score = weighted_impact(ratios, lattice, points, weights, candidate, disjunctive)
        if score > best_score:
            return k, score
    return -1, best_score


@kernel
def climb_hill(
    ratios: FloatArray,
    lattice: Lattice,
    points: FloatArray,
    weights: FloatArray,
    pose: Pose,
    steps: tuple[float, float],
    halvings: int,
    try_once_more: bool,
    disjunctive: bool = False,
) -> tuple[float, float, float, float, int]:
    """Climb to a local maximum along the axes; return x, y, theta, score and the number of poses scored.

    Each round scores six candidates around its start (+x, -y, +theta, -x, +y, -theta) and continues from the best. A
    round without improvement halves the steps (length [m], angle [rad]). The search ends after `halvings` such rounds.
    `try_once_more` then scores +x once more, as the original program does.
    """
    best_x, best_y, best_theta = pose
    best_score = weighted_impact(ratios, lattice, points, weights, pose, disjunctive)
    length, angle = steps
    failures, scored = 0, 1
    while failures < halvings:
        base_x, base_y, base_theta = best_x, best_y, best_theta
        improved = False
        for candidate in range(6):
            sign = 1.0 if candidate in (0, 2, 4) else -1.0
            axis = candidate % 3
            trial = (
                base_x + (sign * length if axis == 0 else 0.0),
                base_y + (sign * length if axis == 1 else 0.0),
                base_theta + (sign * angle if axis == 2 else 0.0),
            )
            score = weighted_impact(ratios, lattice, points, weights, trial, disjunctive)
            scored += 1
            if score > best_score:
                best_score = score
                best_x, best_y, best_theta = trial
                improved = True
        if not improved:
            failures += 1
            length, angle = 0.5 * length, 0.5 * angle
    if try_once_more:
        trial = (best_x + length, best_y, best_theta)
        score = weighted_impact(ratios, lattice, points, weights, trial, disjunctive)
        scored += 1
        if score > best_score:
            best_score = score
            best_x, best_y, best_theta = trial
    return best_x, best_y, best_theta, best_score, scored
