"""A grid as pictures for people, one pixel a cell and y up.

The convention of figure 1 of Dobrokhvalov and Filatov, "Merging Occupancy Grid Map based on Transferable Belief Model",
2021: in a picture of a mass white is all of it; in the pignistic picture free is white, occupied black, unknown grey.
"""

import numpy as np
import numpy.typing as npt

from tbmslam.belief import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.grid import TbmGrid

Picture = npt.NDArray[np.uint8]

_MASSES = {"occupied": OCCUPIED, "free": FREE, "unknown": UNKNOWN, "conflict": CONFLICT}


def draw_grid(grid: TbmGrid) -> dict[str, Picture]:
    """Draw the pignistic probability and each mass.

    Returns
    -------
    Grey pictures (rows, cols) named pignistic, occupied, free, unknown and conflict; the first row is the largest y.
    """
    upright = grid.masses[::-1]
    pictures = {"pignistic": _pignistic(upright)}
    return pictures | {name: _grey(upright[..., mass]) for name, mass in _MASSES.items()}


def encode_png(picture: Picture) -> bytes:
    """Return a grey picture as a PNG file."""
    import cv2  # noqa: PLC0415  reading a map does not need it

    _, png = cv2.imencode(".png", picture)
    return png.tobytes()


def _pignistic(masses: npt.NDArray[np.float32]) -> Picture:
    """Return the probability of free, row by row of blocks, so that a large map needs no second copy of itself."""
    picture = np.empty(masses.shape[:2], dtype=np.uint8)
    for row, cells in enumerate(masses):
        rest = 1.0 - cells[:, CONFLICT]
        bet = cells[:, FREE] + 0.5 * cells[:, UNKNOWN]
        free = np.divide(bet, rest, out=np.full_like(bet, 0.5), where=rest > 0.0)
        picture[row] = _grey(free)
    return picture


def _grey(share: npt.NDArray[np.float32]) -> Picture:
    return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)
