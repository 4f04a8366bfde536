"""A building without end: corridors along both axes between blocks with niches and open rooms, made where one looks."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tbmslam.geometry.se2 import FloatArray


@dataclass(frozen=True)
class CorridorLattice:
    """Corridors whose middles lie at the multiples of a pitch, in x and in y.

    Parameters
    ----------
    seed
        Another seed is another building.
    pitch
        From corridor to corridor [m].
    width
        Of a corridor [m].
    """

    seed: int = 0
    pitch: float = 20.0
    width: float = 2.4

    def __post_init__(self) -> None:
        """Check that blocks have room for niches on all sides."""
        if not 0.0 < self.width < self.pitch / 4.0:
            raise ValueError(f"width must be positive and below a quarter of the pitch, got {self.width}, {self.pitch}")

    def walls_near(self, low: tuple[float, float], high: tuple[float, float]) -> FloatArray:
        """Return the segments (N, 4) [m] of every block that touches the box from `low` to `high`, (x, y) [m]."""
        columns, rows = (
            range(math.floor(first / self.pitch), math.floor(last / self.pitch) + 1)
            for first, last in zip(low, high, strict=True)
        )
        return np.vstack([_block(self, column, row) for column in columns for row in rows])


@lru_cache(maxsize=256)
def _block(lattice: CorridorLattice, column: int, row: int) -> FloatArray:
    """Return the outline (N, 4) of the block right of and above the crossing (column, row)."""
    # A seed must not be negative, and blocks lie on both sides of zero.
    rng = np.random.default_rng([lattice.seed, 31, 2 * abs(column) + (column < 0), 2 * abs(row) + (row < 0)])
    side = lattice.pitch - lattice.width
    outline = np.vstack([_side(side, rng) @ _quarter_turn(turn) for turn in range(4)])
    corner = np.array([column + 0.5, row + 0.5]) * lattice.pitch
    return np.hstack((outline, np.roll(outline, -1, axis=0))) + np.tile(corner, 2)


def _side(side: float, rng: np.random.Generator) -> FloatArray:
    """Return the corners (N, 2) of a block's lower side from left to right, about its middle, without the last."""
    left, bottom = -side / 2.0, -side / 2.0
    deepest = side / 3.0  # niches of two sides may not meet: they keep to the middle half
    points = [(left, bottom)]
    x = left + side / 4.0 + float(rng.uniform(0.0, 1.0))
    while x < side / 4.0:
        wide = float(rng.uniform(0.5, 2.5))
        deep = float(rng.choice([0.1, 0.2, 0.4, rng.uniform(1.0, deepest)]))
        end = min(x + wide, side / 4.0)
        points += [(x, bottom), (x, bottom + deep), (end, bottom + deep), (end, bottom)]
        x = end + float(rng.uniform(0.4, 3.0))
    return np.array(points)


def _quarter_turn(times: int) -> FloatArray:
    """Return the matrix that turns row vectors counter-clockwise by so many quarters."""
    cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[times]
    return np.array([[cosine, sine], [-sine, cosine]])
