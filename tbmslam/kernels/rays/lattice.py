"""Position of the array of a growing grid on the infinite lattice of cells."""

from typing import NamedTuple


class Lattice(NamedTuple):
    """Cells whose corners are multiples of the resolution: column floor(x / resolution), row floor(y / resolution)."""

    resolution: float
    """Side of a cell [m]."""
    first_row: int
    first_col: int
    """Lattice index of cell (0, 0) of the array."""


PlainLattice = tuple[float, int, int]
"""A `Lattice` as a plain tuple, which is passed to a kernel in a quarter of the time."""
