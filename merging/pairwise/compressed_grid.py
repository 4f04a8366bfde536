"""A grid on its way to another process or machine."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid


@dataclass(frozen=True)
class CompressedGrid:
    """A grid that takes little space when it is pickled: most of it is unknown."""

    grid: TbmGrid

    def __reduce__(self) -> tuple[Callable[..., "CompressedGrid"], tuple[GridGeometry, bytes]]:
        """Return what to call to get it back, and with what."""
        masses = np.ascontiguousarray(self.grid.masses, dtype=np.float32)
        return _decompressed, (self.grid.geometry, zlib.compress(masses.tobytes(), level=1))


def _decompressed(geometry: GridGeometry, data: bytes) -> CompressedGrid:
    masses = np.frombuffer(bytearray(zlib.decompress(data)), dtype=np.float32)
    return CompressedGrid(TbmGrid(geometry, masses.reshape(geometry.rows, geometry.cols, 4)))
