"""Pictures as PNG files."""

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]
"""Grey (rows, cols), or of three colours (rows, cols, 3) as OpenCV orders them: blue, green, red."""


def encode_png(picture: Picture) -> bytes:
    """Return a picture as a PNG file."""
    import cv2  # noqa: PLC0415  # slow to load, and reading a map or measuring needs no pictures

    encoded, content = cv2.imencode(".png", picture)
    if not encoded:
        raise ValueError(f"picture must have pixels, got shape {picture.shape}")
    return content.tobytes()
