"""World files: six lines beside a picture that tell QGIS, GDAL and others where it lies."""

from pathlib import Path

from tbmslam.belief.grid import GridGeometry
from tbmslam.io.atomic_file import write_text


def write_world_file(picture: Path, geometry: GridGeometry) -> None:
    """Write the world file of a PNG picture of a grid, one pixel a cell, y up: `NAME.pgw` beside `NAME.png`.

    Coordinates are metres in the map's frame. Source: ESRI's format, "pixel size in x, two rotations, negative pixel
    size in y, centre of the upper left pixel".

    Raises
    ------
    FileNotWrittenError
        If the file cannot be written.
    """
    x, y = geometry.centre_of(geometry.rows - 1, 0)
    step = geometry.resolution
    write_text(picture.with_suffix(".pgw"), "".join(f"{value!r}\n" for value in (step, 0.0, 0.0, -step, x, y)))
