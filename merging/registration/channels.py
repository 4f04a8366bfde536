"""A grid as images: one for the decision value and one for each kind of evidence.

An image's first row is the map's largest y; the flip between the two happens here.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.grids.channels import draw_channels

Image = npt.NDArray[np.uint8]

_OUTSIDE = (128, 0, 0, 255)
"""What nobody saw, in the pignistic, the occupied, the free and the unknown image."""


@dataclass(frozen=True)
class Channels:
    """8-bit images (rows, cols) of a grid, one pixel a cell; the paper's figure 1.

    Parameters
    ----------
    geometry
        Where the images' cells lie in the grid's frame.
    pignistic
        Probability of being free: free is white, occupied black, unknown grey.
    occupied, free, unknown
        The mass on each, 255 for all of it. The conflict is normalised first, as in the paper.
    """

    geometry: GridGeometry
    pignistic: Image
    occupied: Image
    free: Image
    unknown: Image

    @classmethod
    def from_grid(cls, grid: TbmGrid, border: int = 0) -> "Channels":
        """Draw a grid, with a border of so many unknown cells around it.

        Keypoint detectors keep away from the edges of an image; a border gives the walls there a chance.
        """
        geometry = _widened(grid.geometry, border)
        images = np.empty((4, geometry.rows, geometry.cols), dtype=np.uint8)
        images[:] = np.array(_OUTSIDE, dtype=np.uint8)[:, None, None]
        draw_channels(grid.masses, border, images)
        pignistic, occupied, free, unknown = images
        return cls(geometry, pignistic, occupied, free, unknown)

    def to_metres(self, pixels: npt.ArrayLike) -> FloatArray:
        """Carry image coordinates (N, 2), x to the right, y down, pixel centres whole, to the grid's frame [m]."""
        xy = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        geometry = self.geometry
        x = geometry.origin_x + (xy[:, 0] + 0.5) * geometry.resolution
        y = geometry.origin_y + (geometry.rows - 0.5 - xy[:, 1]) * geometry.resolution
        return np.column_stack((x, y))


def flipped(cells: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Turn an array of cells (rows, cols, ...) into an image, or an image into cells."""
    return np.ascontiguousarray(cells[::-1])


def _widened(geometry: GridGeometry, border: int) -> GridGeometry:
    return GridGeometry(
        geometry.resolution,
        geometry.origin_x - border * geometry.resolution,
        geometry.origin_y - border * geometry.resolution,
        geometry.rows + 2 * border,
        geometry.cols + 2 * border,
    )
