"""Images of rotated points, and their correlation by Fourier transforms."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import IntArray, kernel, part

Points = npt.NDArray[np.complex128]
Image = npt.NDArray[np.complex64]
Scores = npt.NDArray[np.float32]


@kernel
def draw_turned(
    walls: Points,
    facing: Points,
    metres: npt.NDArray[np.float64],
    free: Points,
    filled: npt.NDArray[np.float64],
    turn: complex,
    cell: float,
    images: Image,
) -> None:
    """Draw rotated walls and free space into ``images`` (2, rows, cols) around their cell (0, 0).

    The first image receives the rotated and weighted normals ``facing`` (N,) of the walls. The second image receives
    their lengths ``metres`` (N,) as real part, and the shares ``filled`` (M,) of free cells, at most 1, as imaginary
    part. Negative rows and columns wrap around.
    """
    images[:] = 0.0
    rows, cols = _cells(walls, turn, cell, images)
    for index in range(len(walls)):
        row, col = rows[index], cols[index]
        right, up = _turned(facing[index], turn)
        images[0, row, col] += np.complex64(complex(right, up))
        images[1, row, col] += np.complex64(metres[index])
    rows, cols = _cells(free, turn, cell, images)
    for index in range(len(free)):
        row, col = rows[index], cols[index]
        there = images[1, row, col]
        images[1, row, col] = np.complex64(complex(there.real, min(there.imag + filled[index], 1.0)))


@part
def _cells(points: Points, turn: complex, cell: float, images: Image) -> tuple[IntArray, IntArray]:
    """Return the rows and the columns (N,) of the cells of rotated points."""
    count, height, width = len(points), images.shape[1], images.shape[2]
    rows, cols = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    for index in range(count):
        x, y = _turned(points[index], turn)
        rows[index], cols[index] = np.floor(y / cell), np.floor(x / cell)
    for index in range(count):
        rows[index], cols[index] = _wrapped(rows[index], height), _wrapped(cols[index], width)
    return rows, cols


@part
def _wrapped(index: int, size: int) -> int:
    """Return the remainder, by one addition if possible: a division takes ten times as long."""
    index += size if index < 0 else 0
    return index if 0 <= index < size else index % size


@part
def _turned(point: complex, turn: complex) -> tuple[float, float]:
    return point.real * turn.real - point.imag * turn.imag, point.real * turn.imag + point.imag * turn.real


@kernel
def multiply(first: Image, first_target: Image, second: Image, second_target: Image, half: Image) -> None:
    """Write the sum of two correlations, as the half spectrum of its real part, into ``half`` (rows, cols // 2 + 1).

    Each spectrum (rows, cols) is conjugated and multiplied with the spectrum of its target. ``first`` is overwritten.
    """
    rows, cols = first.shape
    for row in range(rows):
        a, b, c, d = first[row], first_target[row], second[row], second_target[row]
        for col in range(cols):
            a[col] = a[col].conjugate() * b[col] + c[col].conjugate() * d[col]
    for row in range(rows):
        ahead, behind, halves = first[row], first[rows - row if row > 0 else 0], half[row]
        halves[0] = np.complex64(0.5) * (ahead[0] + behind[0].conjugate())
        for col in range(1, half.shape[1]):
            halves[col] = np.complex64(0.5) * (ahead[col] + behind[cols - col].conjugate())


@kernel
def block_peaks(scores: Scores, side: int, values: Scores, rows: IntArray, cols: IntArray) -> None:
    """Write the best score of each complete block, its row and its column into ``values``, ``rows`` and ``cols`` (B,).

    Blocks have ``side`` by ``side`` cells and are ordered row by row. Of equal scores the first is taken.
    """
    down, across = scores.shape[0] // side, scores.shape[1] // side
    for block_row in range(down):
        first = block_row * across
        values[first : first + across] = -np.inf
        for row in range(block_row * side, (block_row + 1) * side):
            for block_col in range(across):
                block = first + block_col
                best, where = values[block], -1
                for col in range(block_col * side, (block_col + 1) * side):
                    if scores[row, col] > best:
                        best, where = scores[row, col], col
                if where >= 0:
                    values[block], rows[block], cols[block] = best, row, where
