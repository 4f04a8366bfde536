"""The normal equations of an adjustment of poses, in blocks of 3 by 3."""

from typing import NamedTuple

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel, part
from tbmslam.kernels.arrays import cleared


class LineSystem(NamedTuple):
    """Observed lines, each with two unknowns that are eliminated."""

    couplings: FloatArray
    """Mixed curvature (O, 3, 2) of the pose and the line of each sighting."""
    inverses: FloatArray
    """Inverse curvatures (L, 3) of the lines: aa, ad, dd; zeros for ignored lines."""
    observers: IntArray
    """The pose (O,) of each sighting."""
    begins: IntArray
    """First index of the sightings of each line, and the end of the last line (L + 1,)."""


class MotionSystem(NamedTuple):
    """Motions between poses."""

    ends: IntArray
    """Source and target (E, 2)."""
    across: FloatArray
    """Mixed curvature (E, 3, 3) of source and target; zeros if they are the same pose."""


class PoseSystem(NamedTuple):
    """The normal equations; a small change of a pose is dx, dy in the map's frame and dtheta about its position."""

    own: FloatArray
    """Diagonal blocks (N, 3, 3) of the curvature, with all lines fixed."""
    lines: LineSystem
    motions: MotionSystem


@kernel
def times(system: PoseSystem, changes: FloatArray) -> FloatArray:
    """Return the curvature after the elimination of the lines, times changes (N, 3) of the poses."""
    own, lines, motions = system
    product = np.empty(changes.shape)
    for k in range(len(changes)):
        x, y, theta = changes[k, 0], changes[k, 1], changes[k, 2]
        for i in range(3):
            product[k, i] = own[k, i, 0] * x + own[k, i, 1] * y + own[k, i, 2] * theta
    for e in range(len(motions.ends)):
        _add_motion(motions.across[e], motions.ends[e, 0], motions.ends[e, 1], changes, product)
    couplings, inverses, observers, begins = lines
    for line in range(len(inverses)):
        if inverses[line, 2] == 0.0:
            continue
        turn, shift = 0.0, 0.0
        # Unsigned indices need no check for negative values.
        first, stop = np.uint64(begins[line]), np.uint64(begins[line + 1])
        for o in range(first, stop):
            observer = np.uint64(observers[o])
            x, y, theta = changes[observer, 0], changes[observer, 1], changes[observer, 2]
            turn += couplings[o, 0, 0] * x + couplings[o, 1, 0] * y + couplings[o, 2, 0] * theta
            shift += couplings[o, 0, 1] * x + couplings[o, 1, 1] * y + couplings[o, 2, 1] * theta
        line_turn = inverses[line, 0] * turn + inverses[line, 1] * shift
        line_shift = inverses[line, 1] * turn + inverses[line, 2] * shift
        for o in range(first, stop):
            observer = np.uint64(observers[o])
            for i in range(3):
                product[observer, i] -= couplings[o, i, 0] * line_turn + couplings[o, i, 1] * line_shift
    return product


@part
def _add_motion(across: FloatArray, source: int, target: int, changes: FloatArray, product: FloatArray) -> None:
    """Add the curvature of a motion between two poses times their changes to the product."""
    # All is read before anything is written: the processor need not wait for what it has just written.
    s, t = np.uint64(source), np.uint64(target)
    a, b, c = changes[s, 0], changes[s, 1], changes[s, 2]
    x, y, theta = changes[t, 0], changes[t, 1], changes[t, 2]
    xx, xy, xt = across[0, 0], across[0, 1], across[0, 2]
    yx, yy, yt = across[1, 0], across[1, 1], across[1, 2]
    tx, ty, tt = across[2, 0], across[2, 1], across[2, 2]
    product[s, 0], product[s, 1], product[s, 2] = (
        product[s, 0] + xx * x + xy * y + xt * theta,
        product[s, 1] + yx * x + yy * y + yt * theta,
        product[s, 2] + tx * x + ty * y + tt * theta,
    )
    product[t, 0], product[t, 1], product[t, 2] = (
        product[t, 0] + xx * a + yx * b + tx * c,
        product[t, 1] + xy * a + yy * b + ty * c,
        product[t, 2] + xt * a + yt * b + tt * c,
    )


@part
def add_between(result: FloatArray, left: FloatArray, middle: FloatArray, right: FloatArray, weight: float) -> None:
    """Add weight * left^T middle right to a result; all are (3, 3)."""
    for a in range(3):
        for j in range(3):
            inner = weight * (middle[a, 0] * right[0, j] + middle[a, 1] * right[1, j] + middle[a, 2] * right[2, j])
            for i in range(3):
                result[i, j] += left[a, i] * inner


@part
def eliminated(lines: LineSystem, count: int) -> FloatArray:
    """Return the part of the diagonal blocks (N, 3, 3) that the elimination of the lines removes."""
    taken = cleared(np.empty((count, 3, 3)))
    for line in range(len(lines.inverses)):
        iaa, iad, idd = lines.inverses[line, 0], lines.inverses[line, 1], lines.inverses[line, 2]
        if idd == 0.0:
            continue
        for o in range(lines.begins[line], lines.begins[line + 1]):
            b, block = lines.couplings[o], taken[lines.observers[o]]
            for i in range(3):
                turn, shift = b[i, 0] * iaa + b[i, 1] * iad, b[i, 0] * iad + b[i, 1] * idd
                for j in range(3):
                    block[i, j] += turn * b[j, 0] + shift * b[j, 1]
    return taken
