"""Solution of symmetric positive definite equations with a few hundred unknowns.

Libraries sum in an order that depends on the machine and its threads. Here the order is fixed.
"""

import numpy as np

from tbmslam.kernels import FloatArray, part


@part
def factorise(matrix: FloatArray) -> FloatArray:
    """Return the triangular factor D U (M, M) of a matrix U^T D U, where the diagonal of U is one.

    What is below the diagonal of the matrix is not read. The factor is stored twice, above the diagonal and below it as
    its transpose, so that `solve` reads its columns in the order of memory.
    """
    factor = matrix.copy()
    for k in range(len(factor)):
        row = factor[k]
        for i in range(k + 1, len(factor)):
            ratio = row[i] / row[k]
            if ratio != 0.0:
                to, of = factor[i, i:], row[i:]
                for j in range(len(to)):
                    to[j] -= ratio * of[j]
    for k in range(len(factor)):
        for i in range(k + 1, len(factor)):
            factor[i, k] = factor[k, i]
    return factor


@part
def solve(factor: FloatArray, vector: FloatArray) -> None:
    """Replace the right-hand side (M,) by the solution of the factorised equations."""
    size = len(vector)
    for k in range(size):
        ratio = vector[k] / factor[k, k]
        # Loops are vectorised only with unsigned indices.
        for j in range(np.uint64(k + 1), np.uint64(size)):
            vector[j] -= ratio * factor[k, j]
    for k in range(size - 1, -1, -1):
        known = vector[k] / factor[k, k]
        vector[k] = known
        for j in range(np.uint64(k)):
            vector[j] -= known * factor[k, j]
