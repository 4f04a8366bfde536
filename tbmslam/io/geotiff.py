"""Maps as GeoTIFF, for geographic information systems, and back."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.io.atomic_file import replacing
from tbmslam.map.map_check import MapFileError, check_file, check_geometry

BANDS = ("pignistic", "free", "occupied", "unknown", "conflict")
"""Names of the bands: the probability of being occupied, and the masses."""

_LOCAL = 'LOCAL_CS["map frame",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'


class GeoTiffError(TbmSlamError):
    """A GeoTIFF cannot be written or read here."""


def require_rasterio() -> None:
    """Check that GeoTIFF can be written."""
    try:
        import rasterio  # noqa: F401, PLC0415  # large, and an extra
    except ImportError:
        raise GeoTiffError("a GeoTIFF needs rasterio, which is not installed: pip install 'tbmslam[geotiff]'") from None


def write_geotiff(path: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write a grid atomically: five bands of float32, see `BANDS`; coordinates are metres in its frame.

    The frame lies nowhere on Earth, so the coordinate system is a local one. Raises a `GeoTiffError` if rasterio, which
    writes it, is not installed, and a `FileNotWrittenError` if the file cannot be written.
    """
    require_rasterio()
    import rasterio  # noqa: PLC0415
    from rasterio.crs import CRS  # noqa: PLC0415

    left, _, _, top = grid.geometry.bounds()
    step = grid.geometry.resolution
    masses = grid.masses
    values: list[npt.NDArray[Any]] = [
        grid.pignistic(),
        *(masses[..., subset] for subset in (FREE, OCCUPIED, UNKNOWN, CONFLICT)),
    ]
    with (
        replacing(path) as temporary,
        rasterio.Env(GDAL_PAM_ENABLED="NO"),
        rasterio.open(
            Path(temporary),
            "w",
            driver="GTiff",
            width=grid.geometry.cols,
            height=grid.geometry.rows,
            count=len(BANDS),
            dtype="float32",
            crs=CRS.from_wkt(_LOCAL),
            transform=rasterio.Affine(step, 0.0, left, 0.0, -step, top),
            compress="deflate",
            predictor=3,
        ) as file,
    ):
        for number, (name, band) in enumerate(zip(BANDS, values, strict=True), 1):
            file.write(np.ascontiguousarray(band[::-1], dtype=np.float32), number)
            file.set_band_description(number, name)


def read_geotiff(path: str | os.PathLike[str]) -> TbmGrid:
    """Read a grid that `write_geotiff` wrote.

    Raises a `GeoTiffError` if rasterio, which reads it, is not installed, and a `MapFileError` if it is no such file,
    or damaged.
    """
    require_rasterio()
    import rasterio  # noqa: PLC0415
    from rasterio.errors import RasterioError  # noqa: PLC0415

    check_file(path)
    try:
        with rasterio.open(Path(path)) as file:
            if file.descriptions != BANDS or file.transform.b or file.transform.d:
                raise MapFileError(
                    f"{path}: holds no bands {', '.join(BANDS)}: only a GeoTIFF of tbmslam holds belief masses"
                )
            step, left, top = file.transform.a, file.transform.c, file.transform.f
            geometry = GridGeometry(step, left, top - file.height * step, file.height, file.width)
            check_geometry(path, geometry)
            masses = np.empty((file.height, file.width, 4), dtype=np.float32)
            for number, subset in enumerate((FREE, OCCUPIED, UNKNOWN, CONFLICT), 2):
                masses[..., subset] = file.read(number)[::-1]
    except RasterioError as error:
        raise MapFileError(f"{path}: cannot be read as GeoTIFF ({error}): make it again") from error
    grid = TbmGrid(geometry, masses)
    if (fault := grid.fault()) is not None:
        raise MapFileError(f"{path}: holds no valid masses ({fault}): make it again")
    return grid
