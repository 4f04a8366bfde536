"""Connected pieces of wall."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]


class Components(NamedTuple):
    """Pieces of cells that touch.

    Parameters
    ----------
    labels
        The number of each cell's piece (rows, cols); 0 where there is none.
    stats
        Left, top, width, height and cells (K + 1, 5) of each piece, and of what is none.
    """

    labels: Labels
    stats: Labels

    @classmethod
    def of(cls, cells: BoolArray, *, corners: bool = True) -> "Components":
        """Find the pieces among cells (rows, cols); without `corners` cells that only touch there are apart."""
        connectivity = 8 if corners else 4
        _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=connectivity)
        return cls(np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32))

    @property
    def sides(self) -> tuple[Labels, Labels]:
        """The widths and the heights (K + 1,) of the pieces [cells]."""
        return self.stats[:, cv2.CC_STAT_WIDTH], self.stats[:, cv2.CC_STAT_HEIGHT]

    def at_least(self, side: float) -> "Components":
        """Return the pieces that are so wide or so high [cells]."""
        kept = np.maximum(*self.sides) >= side
        kept[0] = True
        numbers = np.where(kept, np.cumsum(kept) - 1, 0).astype(np.int32)
        return Components(numbers[self.labels], self.stats[kept])

    def cells_of(self, index: int) -> npt.NDArray[np.float32]:
        """Return the columns and rows (N, 2) of one piece's cells, from its corner."""
        left, top, width, height = self.stats[index, : cv2.CC_STAT_AREA]
        rows, cols = np.nonzero(self.labels[top : top + height, left : left + width] == index)
        return np.column_stack((cols, rows)).astype(np.float32)
