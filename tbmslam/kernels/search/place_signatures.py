"""Descriptors of places that do not depend on the frame: distances and angles between pairs of surface points."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import FloatArray, IntArray, kernel, summing_kernel
from tbmslam.kernels.arrays import cleared

Signatures = npt.NDArray[np.float32]

FACINGS = 5
"""Classes of the angle between two normals, from opposite to equal."""


@kernel
def spread_points(points: FloatArray, cell: float, most: int) -> IntArray:
    """Return indices of points (N, 2): the first point in each cell of a lattice, thinned evenly to at most `most`."""
    if len(points) == 0:
        return cleared(np.empty(0, dtype=np.int64))
    cols, rows = np.floor(points[:, 0] / cell), np.floor(points[:, 1] / cell)
    first_row, first_col = rows.min(), cols.min()
    taken = cleared(np.empty((int(rows.max() - first_row) + 1, int(cols.max() - first_col) + 1), dtype=np.bool_))
    chosen = np.empty(len(points), dtype=np.int64)
    count = 0
    for k in range(len(points)):
        row, col = int(rows[k] - first_row), int(cols[k] - first_col)
        if not taken[row, col]:
            taken[row, col] = True
            chosen[count] = k
            count += 1
    kept = min(count, most)
    for k in range(kept):
        chosen[k] = chosen[k * count // kept]
    return chosen[:kept]


@kernel
def pair_signature(points: FloatArray, normals: FloatArray, width: float, bins: int) -> FloatArray:
    """Return the square roots of a histogram of pairs of points (N, 2) by distance and angle, a vector of length 1.

    It is invariant to rotations and translations of the points. The bins of the distance are `width` wide; pairs beyond
    the last bin are ignored. Each bin has `FACINGS` classes of the cosine between the two normals (N, 2).
    """
    shares = cleared(np.empty(bins * FACINGS))
    pairs = 0
    for i in range(len(points)):
        for k in range(i):
            dx, dy = points[i, 0] - points[k, 0], points[i, 1] - points[k, 1]
            slot = int(math.sqrt(dx * dx + dy * dy) / width)
            if slot < bins:
                cosine = normals[i, 0] * normals[k, 0] + normals[i, 1] * normals[k, 1]
                facing = int(cosine > -0.85) + int(cosine > -0.3) + int(cosine > 0.3) + int(cosine > 0.85)
                shares[slot * FACINGS + facing] += 1.0
                pairs += 1
    return np.sqrt(shares / max(pairs, 1))


@summing_kernel
def all_products(signatures: Signatures, others: Signatures) -> Signatures:
    """Return the inner products (P, Q) of signatures (P, B) and (Q, B).

    A matrix product of a library would start threads, which costs far more for such small matrices.
    """
    products = np.empty((len(signatures), len(others)), dtype=np.float32)
    for i in range(len(signatures)):
        for k in range(len(others)):
            total = np.float32(0.0)
            for number in range(signatures.shape[1]):
                total += signatures[i, number] * others[k, number]
            products[i, k] = total
    return products
