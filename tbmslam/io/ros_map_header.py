"""The yaml file of a ROS map, checked."""

import logging
import os
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np
import yaml

from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.io.drive_check import MAX_TURN
from tbmslam.map.map_check import MapFileError, check_file
from tbmslam.map.pixel_rule import Alpha, Mode, PixelRule

logger = logging.getLogger(__name__)

_MAX_BYTES = 1 << 16
_MAX_CELL_M = 1.0


@dataclass(frozen=True)
class RosMapHeader:
    """What a map's yaml file says.

    Parameters
    ----------
    image
        Where the picture lies.
    resolution
        Side of a pixel [m].
    T_map_image
        Pose of the picture's lower left corner.
    pixels
        What they mean.
    """

    image: Path
    resolution: float
    T_map_image: SE2
    pixels: PixelRule


def read_ros_map_header(path: Path) -> RosMapHeader:
    """Read the yaml file of a map.

    Raises
    ------
    MapFileError
        If it cannot be read, lacks a key, or says what makes no map.
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
        raise MapFileError(f"{path}: the yaw of {yaw:.3g} rad in origin is no angle: correct it")
    resolution = _number(path, "resolution", values["resolution"])
    if resolution <= 0.0:
        raise MapFileError(f"{path}: the resolution must be positive, it says {resolution}: correct it")
    if resolution > _MAX_CELL_M:
        raise MapFileError(
            f"{path}: cells of {resolution:g} m show no walls: the resolution is in metres, 0.05 for 5 cm: correct it"
        )
    negate, mode = values["negate"], values.get("mode", "trinary")
    if negate not in (0, 1):  # yaml's true and false are equal to them
        raise MapFileError(f"{path}: negate must be 0 or 1, it is {reprlib.repr(negate)}: correct it")
    if mode not in get_args(Mode):
        raise MapFileError(f"{path}: mode must be trinary, scale or raw, it is {reprlib.repr(mode)}: correct it")
    alpha = values.get("alpha", "unknown")  # a key of our own, which map_server passes over
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
    return RosMapHeader(image, resolution, T_map_image, pixels)


def _parse(path: Path) -> dict[object, object]:
    try:
        check_file(path)
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        # Yaml can be made to take hours or gigabytes; a map's never is long.
        values = yaml.safe_load(content) if len(content) <= _MAX_BYTES else None
    except OSError as error:
        raise MapFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(getattr(error, "problem", None) or error).split())
        raise MapFileError(f"{path}: is no yaml file ({reason[:120]}): correct it") from error
    if not isinstance(values, dict):
        raise MapFileError(f"{path}: is no yaml file of a ROS map: it must say image, resolution and origin")
    return values


def _number(path: Path, key: str, value: object) -> float:
    """Return a finite number; ROS's yaml library takes 1e-2 for one where Python's reads a text."""
    try:
        number = float(value) if isinstance(value, (int, float, str)) and not isinstance(value, bool) else np.nan
    except (ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise MapFileError(f"{path}: {key} must hold finite numbers, it says {reprlib.repr(value)}: correct it")
    return number


def _image_path(path: Path, name: object) -> Path:
    """Return where the picture lies: in the yaml's folder or below, so that a map cannot name any file there is.

    A name of elsewhere, as map savers write for another machine, stands for the file of that name beside the yaml.
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise MapFileError(f"{path}: image must name a file, it is {reprlib.repr(name)}: correct it")
    folder = Path(os.path.normpath(path.parent.absolute()))  # symbolic links stay as they are
    image = Path(os.path.normpath(folder / name))
    if not image.is_relative_to(folder):
        if (folder / image.name).is_file():
            logger.warning("%s: the image %s lies elsewhere: read %s beside it", path, reprlib.repr(name), image.name)
            return path.parent / image.name
        raise MapFileError(f"{path}: the image {reprlib.repr(name)} lies outside the yaml's folder: copy it beside it")
    return path.parent / image.relative_to(folder)
