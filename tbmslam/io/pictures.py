"""The masses of a map as pictures: one pixel for each cell, y up, with a world file."""

import math
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, Masses
from tbmslam.io.atomic_file import write_bytes, write_text
from tbmslam.map.map_check import MapFileError


def write_world_file(picture: Path, geometry: GridGeometry) -> None:
    """Write the world file `NAME.pgw` of a PNG picture of a grid, one pixel for each cell, y up.

    Coordinates are metres in the map's frame. Source: ESRI's format, "pixel size in x, two rotations, negative pixel
    size in y, centre of the upper left pixel".
    """
    x, y = geometry.centre_of(geometry.rows - 1, 0)
    step = geometry.resolution
    write_text(picture.with_suffix(".pgw"), "".join(f"{value!r}\n" for value in (step, 0.0, 0.0, -step, x, y)))


def read_world_file(world_file: Path, rows: int, cols: int) -> GridGeometry:
    """Return the geometry that a world file states for a picture of so many pixels.

    Raises a `MapFileError` if it is no world file, or the pixels are not squares along the axes.
    """
    try:
        values = [float(word) for word in world_file.read_text(encoding="ascii").split()]
    except ValueError:
        values = []
    if len(values) != 6 or any(values[1:3]) or not math.isclose(values[0], -values[3]):
        raise MapFileError(f"{world_file}: is no world file of square pixels without rotation: pass --resolution")
    step, x, y = values[0], *values[4:]
    return GridGeometry(step, x - step / 2.0, y + step / 2.0 - rows * step, rows, cols)


Picture = npt.NDArray[np.uint8]
"""Grey (rows, cols), or of three colours (rows, cols, 3) as OpenCV orders them: blue, green, red."""


def encode_png(picture: Picture) -> bytes:
    """Return a picture as a PNG file."""
    import cv2  # noqa: PLC0415  # slow to load, and only pictures need it

    encoded, content = cv2.imencode(".png", picture)
    if not encoded:
        raise ValueError(f"picture must have pixels, got shape {picture.shape}")
    return content.tobytes()


_MASSES = {"occupied": OCCUPIED, "free": FREE, "unknown": UNKNOWN, "conflict": CONFLICT}
_ROWS_AT_ONCE = 64

PICTURE_NAMES = ("pignistic", *_MASSES)
"""Names of the pictures without suffix."""


def write_pictures(folder: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write pignistic.png, occupied.png, free.png, unknown.png and conflict.png into a folder; see `draw_grid`.

    Beside the first lies pignistic.pgw, which holds the picture's position for other programs.
    """
    for name, picture in draw_grid(grid).items():
        write_bytes(Path(folder, f"{name}.png"), encode_png(picture))
    write_world_file(Path(folder, "pignistic.png"), grid.geometry)


def draw_grid(grid: TbmGrid) -> dict[str, Picture]:
    """Draw the pignistic probability and each mass as grey pictures (rows, cols), the first row at the largest y.

    The pictures are pignistic, occupied, free, unknown and conflict. White is a mass of one. In the pignistic picture
    free is white, occupied black and unknown grey (Dobrokhvalov and Filatov 2021, figure 1).
    """
    rows, cols = grid.geometry.rows, grid.geometry.cols
    pictures = {name: np.empty((rows, cols), dtype=np.uint8) for name in PICTURE_NAMES}
    # A few rows at a time stay in the processor's cache, which is several times faster on large maps.
    for start in range(0, rows, _ROWS_AT_ONCE):
        block = slice(start, min(start + _ROWS_AT_ONCE, rows))
        masses = grid.masses_of_rows(rows - block.stop, rows - block.start)[::-1]
        pictures["pignistic"][block] = _grey(_pignistic_free(masses))
        for name, subset in _MASSES.items():
            pictures[name][block] = _grey(masses[..., subset])
    return pictures


def _pignistic_free(masses: Masses) -> npt.NDArray[np.float32]:
    """Return the pignistic probability (...) of free, in float32 as the masses are."""
    free, unknown = masses[..., FREE], masses[..., UNKNOWN]
    rest = free + masses[..., OCCUPIED] + unknown
    probability = np.full(rest.shape, 0.5, dtype=np.float32)
    np.divide(free + np.float32(0.5) * unknown, rest, out=probability, where=rest > 0.0)
    return probability


def _grey(share: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.asarray(np.rint(np.float32(255.0) * np.clip(share, 0.0, 1.0)))
