"""Masses as 8-bit images with one pixel for each cell."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel


@kernel
def draw_channels(masses: npt.NDArray[np.float32], border: int, images: npt.NDArray[np.uint8]) -> None:
    """Draw ``masses`` (rows, cols, 4) into ``images`` (4, rows + 2 border, cols + 2 border), the last row on top.

    The images are the probability of being free, and the masses on occupied, free and unknown after the conflict is
    normalised; 255 is one. The border and the unknown cells, which are most of a map, are left unchanged.
    """
    rows, cols = masses.shape[0], masses.shape[1]
    for row in range(rows):
        y = border + rows - 1 - row
        for col in range(cols):
            free, occupied, unknown = masses[row, col, 1], masses[row, col, 2], masses[row, col, 3]
            if unknown == 1.0 and free == 0.0 and occupied == 0.0:
                continue
            x = border + col
            rest = float(free) + float(occupied) + float(unknown)
            scale = 255.0 / rest if rest > 0.0 else 0.0
            doubt = unknown * scale if rest > 0.0 else 255.0
            images[0, y, x] = np.uint8(np.rint(free * scale + 0.5 * doubt))
            images[1, y, x] = np.uint8(np.rint(occupied * scale))
            images[2, y, x] = np.uint8(np.rint(free * scale))
            images[3, y, x] = np.uint8(np.rint(doubt))
