"""Conjugate gradients with a two-level preconditioner for the equations of an adjustment.

Conjugate gradients need few steps for local changes, but many for changes that bend a whole drive. The preconditioner
therefore adds the exact solutions of two systems: the blocks of consecutive poses, and a coarse space of few knots
along the drives (additive two-level preconditioning: Toselli and Widlund, "Domain decomposition methods", 2005).
"""

from typing import NamedTuple

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel, part
from tbmslam.kernels.adjustment.pose_systems import LineSystem, PoseSystem, add_between, eliminated, times
from tbmslam.kernels.adjustment.triangular import factorise, solve
from tbmslam.kernels.arrays import cleared


class CoarseSpace(NamedTuple):
    """The coarse space: changes of poses that are interpolated between few knots along the drives."""

    knots: IntArray
    """The poses (K,) that are knots."""
    sides: IntArray
    """The knots (N, 2) before and after each pose."""
    shares: FloatArray
    """The weights (N, 2) of these knots."""


class Preconditioner(NamedTuple):
    """The factorised systems of both levels."""

    inverses: FloatArray
    """Inverse blocks (N, 3, 3) of each pose after the elimination of the poses before it."""
    nexts: FloatArray
    """Mixed curvature (N, 3, 3) of each pose and the next."""
    levers: FloatArray
    """Vector (N, 2, 2) from the knots before and after each pose to the pose [m]."""
    matrix: FloatArray
    """Upper triangular factor (3 K, 3 K) of the curvature of the knots, see `factorise`."""


@kernel
def preconditioner_of(system: PoseSystem, poses: FloatArray, coarse: CoarseSpace) -> Preconditioner:
    """Return the preconditioner at poses (N, 3)."""
    # Element by element, since assigning whole rows takes seconds to compile.
    alone = eliminated(system.lines, len(poses))
    nexts = cleared(np.empty(alone.shape))
    for e in range(len(system.motions.ends)):
        source, target = system.motions.ends[e, 0], system.motions.ends[e, 1]
        for i in range(3):
            for j in range(3):
                if target == source + 1:
                    nexts[source, i, j] += system.motions.across[e, i, j]
                elif source == target + 1:
                    nexts[target, j, i] += system.motions.across[e, i, j]
    inverses, levers = np.empty(alone.shape), np.empty((len(poses), 2, 2))
    for k in range(len(poses)):
        for i in range(3):
            for j in range(3):
                alone[k, i, j] = system.own[k, i, j] - alone[k, i, j]
        if k > 0:
            add_between(alone[k], nexts[k - 1], inverses[k - 1], nexts[k - 1], -1.0)
        _invert(alone[k], inverses[k])
        for side in range(2):
            knot = coarse.knots[coarse.sides[k, side]]
            levers[k, side, 0], levers[k, side, 1] = poses[k, 0] - poses[knot, 0], poses[k, 1] - poses[knot, 1]
    return Preconditioner(inverses, nexts, levers, factorise(_coarse_curvature(system, coarse, levers)))


@part
def precondition(factors: Preconditioner, coarse: CoarseSpace, forces: FloatArray) -> FloatArray:
    """Return approximate changes (N, 3) of the poses for a right-hand side (N, 3)."""
    changes = np.empty(forces.shape)
    _solve_chain(factors, forces, changes)
    knots = cleared(np.empty(3 * len(coarse.knots)))
    for k in range(len(forces)):
        for side in range(2):
            share, at = coarse.shares[k, side], 3 * coarse.sides[k, side]
            dx, dy = factors.levers[k, side, 0], factors.levers[k, side, 1]
            knots[at] += share * forces[k, 0]
            knots[at + 1] += share * forces[k, 1]
            knots[at + 2] += share * (forces[k, 2] + dx * forces[k, 1] - dy * forces[k, 0])
    solve(factors.matrix, knots)
    for k in range(len(forces)):
        for side in range(2):
            share, at = coarse.shares[k, side], 3 * coarse.sides[k, side]
            dx, dy = factors.levers[k, side, 0], factors.levers[k, side, 1]
            changes[k, 0] += share * (knots[at] - dy * knots[at + 2])
            changes[k, 1] += share * (knots[at + 1] + dx * knots[at + 2])
            changes[k, 2] += share * knots[at + 2]
    return changes


@kernel
def conjugate_gradients(
    system: PoseSystem,
    factors: Preconditioner,
    coarse: CoarseSpace,
    gradient: FloatArray,
    precision: float,
    most_steps: int,
) -> FloatArray:
    """Return the changes (N, 3) of the poses for a right-hand side (N, 3).

    Preconditioned conjugate gradients (Saad, "Iterative methods for sparse linear systems", 2003, algorithm 9.1), until
    the ratio of the norms of the residual and of the right-hand side is below `precision`.
    """
    changes, left = cleared(np.empty(gradient.shape)), gradient.copy()
    enough = precision**2 * _product(gradient, gradient)
    before = 0.0
    direction = cleared(np.empty(gradient.shape))
    for _ in range(most_steps):
        if _product(left, left) <= enough:
            break
        near = precondition(factors, coarse, left)
        now = _product(left, near)
        turn = now / before if before > 0.0 else 0.0
        for k in range(len(near)):
            for i in range(3):
                direction[k, i] = near[k, i] + turn * direction[k, i]
        curved = times(system, direction)
        length = now / _product(direction, curved)
        for k in range(len(near)):
            for i in range(3):
                changes[k, i] += length * direction[k, i]
                left[k, i] -= length * curved[k, i]
        before = now
    return changes


@part
def _product(one: FloatArray, other: FloatArray) -> float:
    total = 0.0
    for k in range(len(one)):
        for i in range(3):
            total += one[k, i] * other[k, i]
    return total


@part
def _solve_chain(factors: Preconditioner, forces: FloatArray, changes: FloatArray) -> None:
    """Write the solution (N, 3) of the blocks of consecutive poses for a right-hand side (N, 3)."""
    x, y, theta = 0.0, 0.0, 0.0
    for k in range(len(forces)):
        a, b, c = forces[k, 0], forces[k, 1], forces[k, 2]
        if k > 0:
            across = factors.nexts[k - 1]
            a -= across[0, 0] * x + across[1, 0] * y + across[2, 0] * theta
            b -= across[0, 1] * x + across[1, 1] * y + across[2, 1] * theta
            c -= across[0, 2] * x + across[1, 2] * y + across[2, 2] * theta
        inverse = factors.inverses[k]
        x = inverse[0, 0] * a + inverse[0, 1] * b + inverse[0, 2] * c
        y = inverse[1, 0] * a + inverse[1, 1] * b + inverse[1, 2] * c
        theta = inverse[2, 0] * a + inverse[2, 1] * b + inverse[2, 2] * c
        changes[k, 0], changes[k, 1], changes[k, 2] = x, y, theta
    for k in range(len(forces) - 2, -1, -1):
        across, inverse = factors.nexts[k], factors.inverses[k]
        a = across[0, 0] * x + across[0, 1] * y + across[0, 2] * theta
        b = across[1, 0] * x + across[1, 1] * y + across[1, 2] * theta
        c = across[2, 0] * x + across[2, 1] * y + across[2, 2] * theta
        x = changes[k, 0] - (inverse[0, 0] * a + inverse[0, 1] * b + inverse[0, 2] * c)
        y = changes[k, 1] - (inverse[1, 0] * a + inverse[1, 1] * b + inverse[1, 2] * c)
        theta = changes[k, 2] - (inverse[2, 0] * a + inverse[2, 1] * b + inverse[2, 2] * c)
        changes[k, 0], changes[k, 1], changes[k, 2] = x, y, theta


@part
def _coarse_curvature(system: PoseSystem, coarse: CoarseSpace, levers: FloatArray) -> FloatArray:
    """Return the upper triangle of the curvature (3 K, 3 K) of the knots."""
    count = len(coarse.knots)
    matrix, turned = cleared(np.empty((3 * count, 3 * count))), np.empty((3, 3))
    for k in range(len(system.own)):
        _add_coarse_block(matrix, coarse, levers, k, k, system.own[k])
    for e in range(len(system.motions.ends)):
        source, target = system.motions.ends[e, 0], system.motions.ends[e, 1]
        _add_coarse_block(matrix, coarse, levers, source, target, system.motions.across[e])
        for i in range(3):
            for j in range(3):
                turned[i, j] = system.motions.across[e, j, i]
        _add_coarse_block(matrix, coarse, levers, target, source, turned)
    _eliminate_lines(matrix, system.lines, coarse, levers)
    return matrix


@part
def _eliminate_lines(matrix: FloatArray, lines: LineSystem, coarse: CoarseSpace, levers: FloatArray) -> None:
    """Eliminate the lines from the curvature of the knots."""
    count = len(coarse.knots)
    couplings, met, is_met = (
        cleared(np.empty((count, 6))),
        np.empty(count, dtype=np.int64),
        cleared(np.empty(count, dtype=np.bool_)),
    )
    by_pose, inverses, observers, begins = lines
    sides, shares = coarse.sides, coarse.shares
    for line in range(len(inverses)):
        if inverses[line, 2] == 0.0:
            continue
        touched = 0
        for o in range(begins[line], begins[line + 1]):
            k = observers[o]
            a, b, c, d = by_pose[o, 0, 0], by_pose[o, 0, 1], by_pose[o, 1, 0], by_pose[o, 1, 1]
            for side in range(2):
                knot, share, dx, dy = sides[k, side], shares[k, side], levers[k, side, 0], levers[k, side, 1]
                if not is_met[knot]:
                    is_met[knot], met[touched] = True, knot
                    touched += 1
                couplings[knot, 0] += share * a
                couplings[knot, 1] += share * b
                couplings[knot, 2] += share * c
                couplings[knot, 3] += share * d
                couplings[knot, 4] += share * (by_pose[o, 2, 0] + dx * c - dy * a)
                couplings[knot, 5] += share * (by_pose[o, 2, 1] + dx * d - dy * b)
        _eliminate(matrix, couplings, met[:touched], (inverses[line, 0], inverses[line, 1], inverses[line, 2]))
        for knot in met[:touched]:
            is_met[knot] = False
            for i in range(6):
                couplings[knot, i] = 0.0


@part
def _eliminate(matrix: FloatArray, couplings: FloatArray, knots: IntArray, inverse: tuple[float, float, float]) -> None:
    """Eliminate one line from the curvature of the knots (K,) that are coupled with it by `couplings` (K, 6)."""
    iaa, iad, idd = inverse
    for one in knots:
        for i in range(3):
            a, d, row = couplings[one, 2 * i], couplings[one, 2 * i + 1], 3 * one + i
            turn, shift = a * iaa + d * iad, a * iad + d * idd
            for other in knots:
                for j in range(3 if other >= one else 0):
                    matrix[row, 3 * other + j] -= turn * couplings[other, 2 * j] + shift * couplings[other, 2 * j + 1]


@part
def _add_coarse_block(
    matrix: FloatArray, coarse: CoarseSpace, levers: FloatArray, one: int, other: int, block: FloatArray
) -> None:
    """Add a block (3, 3) of two poses to the upper triangle of the curvature of their knots."""
    for side in range(2):
        share, row = coarse.shares[one, side], 3 * coarse.sides[one, side]
        dx, dy = levers[one, side, 0], levers[one, side, 1]
        for end in range(2):
            weight, col = coarse.shares[other, end], 3 * coarse.sides[other, end]
            ex, ey = levers[other, end, 0], levers[other, end, 1]
            if col < row:
                continue
            for j in range(3):
                # The column of the rotation moves the pose about its knot.
                a, b, c = block[0, j], block[1, j], block[2, j]
                if j == 2:
                    a += ex * block[0, 1] - ey * block[0, 0]
                    b += ex * block[1, 1] - ey * block[1, 0]
                    c += ex * block[2, 1] - ey * block[2, 0]
                matrix[row, col + j] += share * weight * a
                matrix[row + 1, col + j] += share * weight * b
                matrix[row + 2, col + j] += share * weight * (c + dx * b - dy * a)


@part
def _invert(matrix: FloatArray, inverse: FloatArray) -> None:
    """Write the inverse of a symmetric positive definite (3, 3) matrix."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * aa + b * ab + c * ac)
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = scale * aa, scale * (a * f - c * c), scale * (a * d - b * b)
    inverse[0, 1], inverse[0, 2], inverse[1, 2] = scale * ab, scale * ac, scale * (b * c - a * e)
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
