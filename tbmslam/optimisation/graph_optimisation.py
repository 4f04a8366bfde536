"""Pose-graph optimisation: the poses that agree best with measured motions between them, and their covariances.

Levenberg and Marquardt's method, reweighted for a Cauchy kernel (Triggs et al., 2000, sections 4 and 3.4), with the
equations and the solver of bundle adjustment.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, inverse, wrap_angles
from tbmslam.kernels.adjustment.motion_systems import Motions, motion_equations
from tbmslam.kernels.adjustment.pose_systems import LineSystem, PoseSystem
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionEdge, PoseSolver, coarse_space_of, motions_of

_GAUGE = 1e12  # information that fixes the first pose to a micrometre and a microradian [1/m^2, 1/rad^2]
_MOST_STEPS = 30  # largest number of steps; real drives take up to five
_DAMPING = 1e-5  # damping of the first step: nearly none, as a chain is flexible [1/m^2, 1/rad^2]
_MOST_DAMPING = 1e8  # damping from which no step is long enough to matter
_RESIDUE = 1e-5
"""Relative residual at which a step ends; slow bends of a long drive are a small part of the right side."""
_COVARIANCE_RESIDUE = 1e-9  # the same for covariances, which take one solution for each axis
_NO_LINES = LineSystem(np.empty((0, 3, 2)), np.empty((0, 3)), np.empty(0, dtype=np.int64), np.zeros(1, dtype=np.int64))


def optimise(
    poses: FloatArray,
    chain: EdgeArrays,
    closures: Iterable[MotionEdge],
    robust_width: float,
    nodes: IntArray | None = None,
    precision: float = 1e-4,
) -> FloatArray:
    """Return the poses (M, 3) of some nodes that agree best with all edges; the first stays where it is.

    `poses` (N, 3) are the initial ones: x [m], y [m], theta [rad]. `chain` has trusted motions between nodes, and
    `closures` motions between nodes that saw the same place; together they connect all nodes. Closures beyond
    `robust_width` standard deviations (Cauchy kernel) lose weight, so that a false closure cannot bend the map. `nodes`
    (M,) are the rising indices of the poses to solve for; None for all. The steps end at a relative decrease of the
    error below `precision`.
    """
    if nodes is None:
        nodes = np.arange(len(poses))
    at = poses[nodes]
    if len(at) < 2:
        return at
    numbers = np.zeros(len(poses), dtype=np.int64)
    numbers[nodes] = np.arange(len(nodes))
    motions = motions_of(chain, EdgeArrays.of([*closures]), robust_width, numbers, np.zeros((len(poses), 3)))
    coarse, damping = coarse_space_of([0, len(at)]), _DAMPING
    error = _error(motions, at)
    for _ in range(_MOST_STEPS):
        own, system, gradient = motion_equations(motions, at)
        own[0] += _GAUGE * np.eye(3)
        while True:
            damped = own + damping * np.eye(3)
            step = PoseSolver(PoseSystem(damped, _NO_LINES, system), at, coarse, _RESIDUE).solve(gradient)
            moved = at - step
            moved[:, 2] = wrap_angles(moved[:, 2])
            left = _error(motions, moved)
            if left <= error:
                break
            damping *= 10.0
            if damping > _MOST_DAMPING:
                return at
        at, gain, error = moved, error - left, left
        damping = max(0.1 * damping, _DAMPING)
        if gain <= precision * error:
            break
    return at


def _error(motions: Motions, poses: FloatArray) -> float:
    """Return half the sum of the squared deviations of motions under the robust kernels."""
    sources, targets = poses[motions.ends[:, 0]], poses[motions.ends[:, 1]]
    errors = compose(inverse(motions.measured), compose(inverse(sources), targets))
    errors[:, 2] = wrap_angles(errors[:, 2])
    squares = np.einsum("ei,eij,ej->e", errors, motions.informations, errors)
    widths = motions.widths**2
    is_robust = np.isfinite(widths)
    squares[is_robust] = widths[is_robust] * np.log1p(squares[is_robust] / widths[is_robust])
    return 0.5 * float(squares.sum())


def relative_covariance(
    poses: FloatArray,
    chain: EdgeArrays,
    closures: Sequence[MotionEdge],
    robust_width: float,
    source: int,
    target: int,
) -> FloatArray:
    """Return the covariance (3, 3) of the target pose relative to the source pose, in the target's frame.

    Edges are as in `optimise`. The covariance is a block of the inverse of the Gauss-Newton matrix (Kaess and Dellaert,
    "Covariance recovery from a square root information matrix for data association", 2009). Chain and closures together
    connect source and target.
    """
    doubted = EdgeArrays.of(closures)
    nodes = np.unique(np.concatenate((chain.ends, doubted.ends)))
    numbers = np.zeros(len(poses), dtype=np.int64)
    numbers[nodes] = np.arange(len(nodes))
    motions = motions_of(chain, doubted, robust_width, numbers, np.zeros((len(poses), 3)))
    at, coarse = poses[nodes], coarse_space_of([0, len(nodes)])
    own, system, _ = motion_equations(motions, at)
    held, asked = numbers[source], numbers[target]
    own[held] += _GAUGE * np.eye(3)
    solver = PoseSolver(PoseSystem(own, _NO_LINES, system), at, coarse, _COVARIANCE_RESIDUE)
    in_map = np.empty((3, 3))
    for axis in range(3):
        force = np.zeros((len(nodes), 3))
        force[asked, axis] = 1.0
        in_map[:, axis] = solver.solve(force)[asked]
    rotation = SE2(0.0, 0.0, float(poses[target, 2])).matrix()
    covariance: FloatArray = rotation.T @ in_map @ rotation
    return covariance
