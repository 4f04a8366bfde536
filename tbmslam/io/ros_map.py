"""Maps in the format of map_server and nav2: a yaml file, and a picture whose top row has the largest y."""

import logging
import os
import reprlib
from dataclasses import dataclass, replace
from pathlib import Path, PureWindowsPath
from typing import cast, get_args

import numpy as np
import numpy.typing as npt
import yaml

from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_occupancy, occupancy_of
from tbmslam.belief.grid_resampling import canvas_of, resample
from tbmslam.belief.masses import Masses
from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.io.atomic_file import write_bytes, write_text
from tbmslam.map.map_check import MAX_TURN, MapFileError, check_file, check_geometry
from tbmslam.map.map_image import (
    FREE_THRESHOLD,
    OCCUPIED_THRESHOLD,
    Alpha,
    MapImage,
    Mode,
    PixelRule,
    encode_pgm,
    occupancy_of_image,
    read_image,
)

logger = logging.getLogger(__name__)

_MAX_BYTES = 1 << 16
_MAX_CELL_M = 1.0


@dataclass(frozen=True)
class RosMapHeader:
    """The content of a map's yaml file."""

    image: Path
    resolution: float
    """Side of a pixel [m]."""
    T_map_image: SE2
    """Pose of the picture's lower left corner."""
    pixels: PixelRule
    stated_image: str
    """The picture as the file names it; `image` is beside the file if that is a path of another machine."""


def read_ros_map_header(path: Path) -> RosMapHeader:
    """Read the yaml file of a map.

    Raises a `MapFileError` if the file cannot be read, lacks a key, or has an invalid value.
    """
    values = _parse(path)
    needed = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")  # as in map_server
    if missing := [key for key in needed if key not in values]:
        raise MapFileError(f"{path}: lacks {', '.join(missing)}: add it, if this is the yaml file of a ROS map")
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapFileError(f"{path}: origin must be [x, y, yaw], it is {reprlib.repr(origin)}: correct it")
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    if abs(yaw) > MAX_TURN:
        raise MapFileError(f"{path}: the yaw of {yaw:.3g} rad in origin is too large: correct it")
    resolution = _number(path, "resolution", values["resolution"])
    if resolution <= 0.0:
        raise MapFileError(f"{path}: the resolution must be positive, got {resolution}: correct it")
    if resolution > _MAX_CELL_M:
        raise MapFileError(
            f"{path}: cells of {resolution:g} m are too large for walls: the resolution is in metres, 0.05 for 5 cm: "
            f"correct it"
        )
    negate, mode = values["negate"], values.get("mode", "trinary")
    if negate not in (0, 1):  # yaml's true and false are equal to them
        raise MapFileError(f"{path}: negate must be 0 or 1, it is {reprlib.repr(negate)}: correct it")
    if mode not in get_args(Mode):
        raise MapFileError(f"{path}: mode must be trinary, scale or raw, it is {reprlib.repr(mode)}: correct it")
    alpha = values.get("alpha", "unknown")  # a key of this project, which map_server ignores
    if alpha not in get_args(Alpha):
        raise MapFileError(f"{path}: alpha must be unknown or average, it is {reprlib.repr(alpha)}: correct it")
    occupied, free = (_number(path, key, values[key]) for key in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free < occupied <= 1.0:
        raise MapFileError(
            f"{path}: thresholds must be 0 <= free_thresh < occupied_thresh <= 1, they are {free} and {occupied}: "
            "correct them"
        )
    image = _image_path(path, values["image"])
    T_map_image = SE2(x, y, wrap_angle(yaw))
    pixels = PixelRule(bool(negate), occupied, free, cast("Mode", mode), cast("Alpha", alpha))
    return RosMapHeader(image, resolution, T_map_image, pixels, str(values["image"]))


def _parse(path: Path) -> dict[object, object]:
    try:
        check_file(path)
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        # A malicious yaml file may take hours or gigabytes; that of a map is short.
        values = yaml.safe_load(content) if len(content) <= _MAX_BYTES else None
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise MapFileError(f"{path}: is no yaml file ({reason[:120]}): correct it") from error
    if not isinstance(values, dict):
        raise MapFileError(f"{path}: is no yaml file of a ROS map: it must state image, resolution and origin")
    return values


def _number(path: Path, key: str, value: object) -> float:
    """Return a finite number, also for 1e-2, which is a text for Python's yaml library but a number for that of ROS."""
    try:
        number = float(value) if isinstance(value, (int, float, str)) and not isinstance(value, bool) else np.nan
    except (ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise MapFileError(f"{path}: {key} must hold finite numbers, got {reprlib.repr(value)}: correct it")
    return number


def _image_path(path: Path, name: object) -> Path:
    """Return the path of the picture, which must be in the yaml's folder or below: a map must not name any other file.

    If a path does not exist, as one of another machine, the file of that name beside the yaml is used.
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise MapFileError(f"{path}: image must name a file, it is {reprlib.repr(name)}: correct it")
    folder = Path(os.path.normpath(path.parent.absolute()))  # symbolic links stay as they are
    image = _place(folder, name)
    if not image.is_relative_to(folder):
        if (folder / image.name).is_file():
            return path.parent / image.name
        raise MapFileError(f"{path}: the image {reprlib.repr(name)} lies outside the yaml's folder: copy it beside it")
    return path.parent / image.relative_to(folder)


def _place(folder: Path, name: str) -> Path:
    """Return the place that a name in the yaml of a folder states, which may be a path of Windows."""
    place = Path(os.path.normpath(folder / name))
    windows = PureWindowsPath(name)
    if "\\" not in name or place.is_file():
        return place
    return Path(os.path.normpath(folder / (f"/{windows.name}" if windows.anchor else windows.as_posix())))


def _warn_of_another_machine(path: Path, header: RosMapHeader) -> None:
    stated = _place(path.parent.absolute(), header.stated_image)
    if stated != Path(os.path.normpath(header.image.absolute())):
        name, beside = reprlib.repr(header.stated_image), header.image.name
        logger.warning("%s: the image %s lies outside its folder: %s beside it is read", path, name, beside)


FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0
_OF_SAVERS = (FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL, 255)
_MENDED = 0.01  # largest share of other greys in a map saver's picture, as from a brush


def write_ros_map(path: str | os.PathLike[str], grid: TbmGrid) -> None:
    """Write a grid as a yaml file and its picture, of the same name with the suffix .pgm.

    The yaw is 0 since a grid's cells lie along the axes; that suits costmaps and AMCL, which ignore a yaw.
    """
    image = Path(path).with_suffix(".pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(grid.geometry.resolution),
        "origin": [float(grid.geometry.origin_x), float(grid.geometry.origin_y), 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESHOLD,
        "free_thresh": FREE_THRESHOLD,
    }
    write_bytes(image, encode_pgm(ros_pixels(grid)))
    write_text(path, yaml.safe_dump(header, sort_keys=False, default_flow_style=None))


def ros_pixels(grid: TbmGrid) -> npt.NDArray[np.uint8]:
    """Return a picture (rows, cols) of a grid, top row first: 254 free, 0 occupied, 205 unknown; see `occupancy_of`."""
    occupancy = occupancy_of(grid)[::-1]
    pixels = np.full(occupancy.shape, UNKNOWN_PIXEL, dtype=np.uint8)
    pixels[occupancy == 0] = FREE_PIXEL
    pixels[occupancy == 100] = OCCUPIED_PIXEL
    return pixels


def read_ros_map(path: str | os.PathLike[str]) -> TbmGrid:
    """Read a map of map_server or nav2 as beliefs; a rotated map is resampled along the axes.

    `tbmslam.belief.grid` defines the masses of an occupancy: full occupancy keeps 0.1 unknown. Cells that a map saver
    wrote as unknown stay unknown, whatever its `free_thresh`. This causes a warning, and so does a map without any
    unknown cell. Raises a `MapFileError` if the yaml or its picture is missing, damaged, too large, or has
    an invalid value.
    """
    header = read_ros_map_header(Path(path))
    _warn_of_another_machine(Path(path), header)
    if not header.image.exists():
        raise MapFileError(
            f"{path}: names the image {reprlib.repr(header.stated_image)}, but {header.image} does not exist: "
            "correct the name in the yaml, or restore the picture"
        )
    image = read_image(header.image)
    corner = header.T_map_image
    check_geometry(path, GridGeometry(header.resolution, corner.x, corner.y, *image.pixels.shape[:2]))
    _warn_of_transparency(Path(path), image, header.pixels)
    rule = header.pixels
    if _frees_the_unknown(image, rule):
        logger.warning(
            "%s: with free_thresh %g the unknown pixels (%d) of its map saver would be free: they are read as unknown",
            path,
            rule.free_threshold,
            UNKNOWN_PIXEL,
        )
        rule = replace(rule, free_threshold=FREE_THRESHOLD)
    occupancy = occupancy_of_image(image, rule)
    if image.alpha is not None and not (occupancy == 100).any():
        opaque = MapImage(image.pixels[..., :-1], image.maximum)
        if (occupancy_of_image(opaque, rule) == 100).any():
            logger.warning("%s: holds no wall, because all of its walls are transparent: paint them opaque", path)
    if not (occupancy < 0).any():
        logger.warning(
            "%s: none of its cells is unknown, so unexplored cells contradict other maps: paint them grey (%d), with "
            "mode trinary, negate 0 and free_thresh %g",
            path,
            UNKNOWN_PIXEL,
            FREE_THRESHOLD,
        )
    return grid_at(Path(path), header.resolution, corner, masses_from_occupancy(occupancy))


def grid_at(path: Path, resolution: float, corner: SE2, masses: Masses) -> TbmGrid:
    """Return the grid of a map by the pose of its lower left corner; a rotated map is resampled along the axes.

    Raises a `MapFileError` that names the path if the resampled map would be too large.
    """
    geometry = GridGeometry(resolution, corner.x, corner.y, *masses.shape[:2])
    if corner.theta == 0.0:
        return TbmGrid(geometry, masses)
    turned = TbmGrid(geometry._replace(origin_x=0.0, origin_y=0.0), masses)
    canvas = canvas_of(turned.geometry, corner)
    check_geometry(path, canvas)
    return resample(turned, corner, canvas)


def _warn_of_transparency(path: Path, image: MapImage, rule: PixelRule) -> None:
    """Warn of transparent pixels and of their meaning."""
    share = 0.0 if image.alpha is None else float((image.alpha < image.maximum).mean())
    if share == 0.0 or rule.mode == "raw":
        return
    taken = "alpha is averaged with the colours" if rule.averages_alpha else "read as unknown"
    other = "" if rule.mode == "scale" or rule.averages_alpha else "; `alpha: average` reads it as in ROS 1"
    logger.warning("%s: %.0f %% of the picture is not opaque: %s%s", path, 100.0 * share, taken, other)


def _frees_the_unknown(image: MapImage, rule: PixelRule) -> bool:
    """Return whether a picture has the values of map savers, and the thresholds make unknown cells free.

    See slam_toolbox issue 587 and nav2 issue 5138. A picture edited by hand has white areas and a few greys.
    """
    if rule.mode != "trinary" or rule.negate or image.maximum != 255:
        return False
    if not rule.free_threshold > (255 - UNKNOWN_PIXEL) / 255.0:
        return False
    sums, white = image.channel_sum(with_alpha=rule.averages_alpha)
    if image.alpha is not None and not rule.averages_alpha:
        sums = sums[image.alpha == image.maximum]
    values, counts = np.unique(sums, return_counts=True)
    of_savers = np.isin(values * 255, np.array(_OF_SAVERS) * white)
    return bool((values * 255 == UNKNOWN_PIXEL * white).any() and counts[~of_savers].sum() <= _MENDED * counts.sum())
