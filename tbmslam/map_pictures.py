"""A map's masses as grey pictures, one pixel a cell, y up."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tbmslam.atomic_file import write_bytes
from tbmslam.belief import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.grid import TbmGrid

_MASSES = {"occupied": OCCUPIED, "free": FREE, "unknown": UNKNOWN, "conflict": CONFLICT}


def write_pictures(folder: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write pignistic.png, occupied.png, free.png, unknown.png and conflict.png into a folder.

    White is all of a mass; in the pignistic picture free is white, occupied black and unknown grey. Dobrokhvalov and
    Filatov 2021, figure 1.
    """
    write_bytes(Path(folder, "pignistic.png"), _png(1.0 - grid.pignistic()))
    for name, subset in _MASSES.items():
        write_bytes(Path(folder, f"{name}.png"), _png(grid.masses[..., subset]))


def _png(values: npt.NDArray[np.floating[Any]]) -> bytes:
    """Encode values (rows, cols) within [0, 1], the first row at the bottom."""
    import cv2  # noqa: PLC0415  # slow to load

    image = np.rint(255.0 * np.clip(values[::-1], 0.0, 1.0)).astype(np.uint8)
    encoded, content = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not encoded:
        raise ValueError(f"values must make a picture, got shape {values.shape}")
    return content.tobytes()
