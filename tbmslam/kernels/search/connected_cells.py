"""Connected components of cells."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import IntArray, kernel, part
from tbmslam.kernels.arrays import cleared

Labels = npt.NDArray[np.int32]


@kernel
def components_of(cells: IntArray, reach: int) -> IntArray:
    """Return the component (N,) of each cell, numbered from 0 in the order of their first cells.

    Two cells are connected if their rows and their columns differ by at most ``reach``. The rows and columns (N, 2) are
    not negative, unique, and sorted by row and then by column.
    """
    count = len(cells)
    number = np.empty(count, dtype=np.int64)
    if count == 0:
        return number
    first = cleared(np.empty(cells[-1, 0] + 2, dtype=np.int64))  # of each row, the number of cells before it
    for index in range(count):
        first[cells[index, 0] + 1] += 1
    for row in range(1, len(first)):
        first[row] += first[row - 1]
    parent = np.arange(count)
    for row in range(len(first) - 1):
        for above in range(max(row - reach, 0), row + 1):
            near = first[above]
            for index in range(first[row], first[row + 1]):
                col = cells[index, 1]
                while near < first[above + 1] and cells[near, 1] < col - reach:
                    near += 1
                other = near
                while other < first[above + 1] and cells[other, 1] <= col + reach:
                    a, b = _root(parent, index), _root(parent, other)
                    parent[max(a, b)] = min(a, b)
                    other += 1
    pieces = 0
    for index in range(count):
        root = _root(parent, index)
        if root == index:
            number[index] = pieces
            pieces += 1
        else:
            number[index] = number[root]
    return number


@part
def _root(parent: IntArray, index: int) -> int:
    while parent[index] != index:
        parent[index] = parent[parent[index]]
        index = parent[index]
    return index


@kernel
def boxes_of(labels: Labels, count: int) -> Labels:
    """Return left, top, width, height and number of cells (K, 5) of the components in an image of labels (rows, cols).

    Labels are from 0 up to, and without, ``count``. A label without cells has zeros.
    """
    boxes = cleared(np.empty((count, 5), dtype=np.int32))
    rows, cols = labels.shape
    for row in range(rows):
        first = 0
        while first < cols:
            label, end = labels[row, first], first + 1
            while end < cols and labels[row, end] == label:
                end += 1
            box = boxes[label]
            if box[4] == 0:
                box[0], box[1], box[2] = first, row, end - first
            left = min(box[0], first)
            box[0], box[2] = left, max(box[0] + box[2], end) - left
            box[3] = row + 1 - box[1]
            box[4] += end - first
            first = end
    return boxes
