"""Maps as ROS keeps them, for map_server and nav2: a yaml file and a picture whose top row has the largest y."""

import logging
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import yaml

from tbmslam.belief.grid import GridGeometry, Masses, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.io.atomic_file import write_bytes, write_text
from tbmslam.io.map_check import check_geometry
from tbmslam.io.map_image import MapImage, encode_pgm, read_image
from tbmslam.io.occupancy import masses_from_probability
from tbmslam.io.ros_map_header import RosMapHeader, read_ros_map_header

logger = logging.getLogger(__name__)

MIN_BALANCE = 0.1
"""How far the masses of free and occupied must differ for a cell to be painted; see `ros_pixels`."""
FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0
_OF_SAVERS = (FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL, 255)
_MENDED = 0.01
"""So large a share of a map saver's picture may hold other greys, where a brush was drawn over it."""
_BAND = 256
"""So many rows of cells are painted at once."""
_OCCUPIED_THRESHOLD = 0.65
_FREE_THRESHOLD = 0.196
"""nav2's own saver says 0.25, and then the pixel 205 of unknown cells, 50/255 = 0.19608, is free when read again."""


def write_ros_map(stem: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write a grid as `stem`.yaml and `stem`.pgm, or as map.yaml and map.pgm in it where `stem` is a folder.

    The yaw is 0 since a grid's cells lie along the axes; that suits costmaps and AMCL, which ignore a yaw.

    Raises
    ------
    FileNotWrittenError
        If a file cannot be written.
    """
    place = Path(stem)
    place = place / "map" if place.is_dir() else place
    image = place.with_name(f"{place.name}.pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(grid.geometry.resolution),
        "origin": [float(grid.geometry.origin_x), float(grid.geometry.origin_y), 0.0],
        "negate": 0,
        "occupied_thresh": _OCCUPIED_THRESHOLD,
        "free_thresh": _FREE_THRESHOLD,
    }
    write_bytes(image, encode_pgm(ros_pixels(grid)))
    write_text(place.with_name(f"{place.name}.yaml"), yaml.safe_dump(header, sort_keys=False, default_flow_style=None))


def ros_pixels(grid: TbmGrid) -> npt.NDArray[np.uint8]:
    """Paint a grid (rows, cols), top row first: 254 free, 0 occupied, 205 unknown.

    A cell is occupied where its pignistic probability is above 0.55 and free where it is below 0.45, that is where the
    masses of the two differ by `MIN_BALANCE` of what is not conflict. A cell with hardly any evidence, or with as much
    for as against, is unknown. The bounds lie near one half because the pignistic probability counts half of UNKNOWN
    either way, and free space is learnt slowly: after 100 misses vinySLAM's m(FREE) is 0.23.
    """
    pixels = np.full(grid.masses.shape[:2], UNKNOWN_PIXEL, dtype=np.uint8)
    for first in range(0, len(pixels), _BAND):  # whole maps of what is computed would take more memory than the map
        masses, painted = grid.masses[::-1][first : first + _BAND], pixels[first : first + _BAND]
        balance = masses[..., OCCUPIED] - masses[..., FREE]
        needed = MIN_BALANCE * (1.0 - masses[..., CONFLICT])
        painted[balance > needed] = OCCUPIED_PIXEL
        painted[-balance > needed] = FREE_PIXEL
    return pixels


def read_ros_map(path: str | os.PathLike[str]) -> TbmGrid:
    """Read a map of map_server or nav2 as beliefs; a turned map is resampled to lie along the axes.

    What masses an occupancy becomes is said in `tbmslam.io.occupancy`: full occupancy keeps 0.1 unknown. Cells that
    a map saver wrote as unknown stay so, whatever `free_thresh` it wrote beside them; a warning tells of it, and
    another of a map without any unknown cell.

    Raises
    ------
    MapFileError
        If the yaml or its picture is missing, damaged, too large, or says what makes no map.
    """
    header = read_ros_map_header(Path(path))
    image = read_image(header.image)
    rows, cols = image.pixels.shape[:2]
    corner = header.T_map_image
    geometry = GridGeometry(header.resolution, corner.x, corner.y, rows, cols)
    check_geometry(path, geometry)
    _tell_of_transparency(Path(path), image, header)
    if _frees_the_unknown(image, header):
        logger.warning(
            "%s: by free_thresh %g what its map saver left unknown (%d) would be free: taken as unknown",
            path,
            header.free_threshold,
            UNKNOWN_PIXEL,
        )
        header = replace(header, free_threshold=_FREE_THRESHOLD)
    occupancy = occupancy_of_image(image, header)
    if image.alpha is not None and not (occupancy == 100).any():
        opaque = MapImage(image.pixels[..., :-1], image.maximum)
        if (occupancy_of_image(opaque, header) == 100).any():
            logger.warning("%s: holds no wall, since all of its walls are transparent: paint them opaque", path)
    if not (occupancy < 0).any():
        logger.warning(
            "%s: none of its cells is unknown, so that what nobody saw speaks against other maps: paint it grey (%d), "
            "with mode trinary, negate 0 and free_thresh %g",
            path,
            UNKNOWN_PIXEL,
            _FREE_THRESHOLD,
        )
    masses = _masses(occupancy)
    if corner.theta == 0.0:
        return TbmGrid(geometry, masses)
    turned = TbmGrid(geometry._replace(origin_x=0.0, origin_y=0.0), masses)
    canvas = _canvas(turned.geometry, corner)
    check_geometry(path, canvas)
    return resample(turned, corner, canvas)


def occupancy_of_image(image: MapImage, header: RosMapHeader) -> npt.NDArray[np.int8]:
    """Return the occupancy (rows, cols) that map_server publishes: 0 to 100, -1 unknown; row grows with y.

    Colours are averaged. What is not opaque is unknown but in raw mode, as in nav2_map_server since pull request 5071
    (2025). Before, and in ROS 1, alpha was averaged with the colours in trinary mode: `alpha: average` in the yaml.
    """
    sums, white = image.channel_sum(with_alpha=_averages_alpha(header))
    # A pixel's occupancy depends on the sum of its channels alone: one value for each, looked up afterwards.
    occupancy = _occupancies(np.arange(white + 1), white, header)[sums]
    if image.alpha is not None and header.mode != "raw" and not _averages_alpha(header):
        occupancy[image.alpha < image.maximum] = -1
    return np.ascontiguousarray(occupancy[::-1])


def _averages_alpha(header: RosMapHeader) -> bool:
    return header.mode == "trinary" and header.alpha == "average"


def _tell_of_transparency(path: Path, image: MapImage, header: RosMapHeader) -> None:
    """Say how much of a picture is transparent, and what that is taken for."""
    share = 0.0 if image.alpha is None else float((image.alpha < image.maximum).mean())
    if share == 0.0 or header.mode == "raw":
        return
    taken = "alpha is averaged with the colours" if _averages_alpha(header) else "taken as unknown"
    other = "" if header.mode == "scale" or _averages_alpha(header) else "; `alpha: average` reads it as in ROS 1"
    logger.warning("%s: %.0f %% of the picture is not opaque: %s%s", path, 100.0 * share, taken, other)


def _frees_the_unknown(image: MapImage, header: RosMapHeader) -> bool:
    """Tell whether a picture has the values of map savers, and the thresholds take the unknown for free.

    See slam_toolbox issue 587 and nav2 issue 5138. Who mends a picture by hand paints white, and leaves a few greys.
    """
    if header.mode != "trinary" or header.negate or image.maximum != 255:
        return False
    if not header.free_threshold > (255 - UNKNOWN_PIXEL) / 255.0:
        return False
    sums, white = image.channel_sum(with_alpha=_averages_alpha(header))
    if image.alpha is not None and not _averages_alpha(header):
        sums = sums[image.alpha == image.maximum]
    values, counts = np.unique(sums, return_counts=True)
    of_savers = np.isin(values * 255, np.array(_OF_SAVERS) * white)
    return bool((values * 255 == UNKNOWN_PIXEL * white).any() and counts[~of_savers].sum() <= _MENDED * counts.sum())


def _occupancies(sums: npt.NDArray[np.int64], white: int, header: RosMapHeader) -> npt.NDArray[np.int8]:
    if header.mode == "raw":
        percent = np.floor(sums / white * 255.0 + 0.5)
        return np.where(percent <= 100.0, percent, -1.0).astype(np.int8)
    p = (sums if header.negate else white - sums) / white
    low, high = header.free_threshold, header.occupied_threshold
    between = np.rint((p - low) / (high - low) * 100.0) if header.mode == "scale" else -1.0
    return np.where(p > high, 100.0, np.where(p < low, 0.0, between)).astype(np.int8)


def _masses(occupancy: npt.NDArray[np.int8]) -> Masses:
    percent = np.arange(-1, 101)
    table = masses_from_probability(percent / 100.0, known=percent >= 0)
    return np.asarray(table[occupancy.astype(np.int16) + 1])


def _canvas(image: GridGeometry, T_map_image: SE2) -> GridGeometry:
    """Return the cells of the map that a turned picture lies on."""
    left, bottom, right, top = image.bounds()
    corners = T_map_image.apply([(left, bottom), (right, bottom), (right, top), (left, top)])
    low = corners.min(axis=0)
    # Rounding must not add a row of cells that the picture does not reach.
    cols, rows = np.ceil((corners.max(axis=0) - low) / image.resolution - 1e-6).astype(int)
    return GridGeometry(image.resolution, float(low[0]), float(low[1]), int(rows), int(cols))
