"""A grid as images: one for the decision value and one for each kind of evidence.

An image's first row is the map's largest y; the flip between the two happens here.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.belief import FREE, OCCUPIED, UNKNOWN, normalise
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.se2 import FloatArray

Image = npt.NDArray[np.uint8]


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
        masses = normalise(grid.masses)
        return cls(
            geometry,
            pignistic=_image(masses[..., FREE] + 0.5 * masses[..., UNKNOWN], border, outside=0.5),
            occupied=_image(masses[..., OCCUPIED], border, outside=0.0),
            free=_image(masses[..., FREE], border, outside=0.0),
            unknown=_image(masses[..., UNKNOWN], border, outside=1.0),
        )

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


def _image(values: FloatArray, border: int, outside: float) -> Image:
    padded = np.pad(values, border, constant_values=outside)
    return np.ascontiguousarray(np.rint(255.0 * padded[::-1])).astype(np.uint8)
