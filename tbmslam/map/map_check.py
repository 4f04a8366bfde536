"""Checks of maps and drives from files, for all formats."""

import os
from pathlib import Path

import numpy as np

from tbmslam.belief.grid import GridGeometry
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import FloatArray
from tbmslam.machine_memory import machine_memory
from tbmslam.map.drive import Drive
from tbmslam.sensing.laser_scan import FARTHEST_PLACE
from tbmslam.special_file import why_unreadable

MAX_CELLS = 400_000_000
"""Largest plausible number of cells: 1 km by 1 km in cells of 5 cm, and 6.4 GB of masses."""

_BYTES_A_CELL = 20  # four masses and their input

SMALLEST_CELL, LARGEST_CELL = 1e-3, 100.0
"""Least and largest plausible resolution [m]."""


class MapFileError(TbmSlamError):
    """A file does not contain a valid map. The message states the file, the problem and the remedy."""


def check_file(path: str | os.PathLike[str]) -> None:
    """Raise a `MapFileError` for an empty file, or a device or pipe, whose reading may never end."""
    if why := why_unreadable(Path(path)):
        raise MapFileError(f"{path}: {why}: give a map's folder or file")


def check_geometry(path: str | os.PathLike[str], geometry: GridGeometry) -> None:
    """Check numbers that a file declares, before memory is allocated.

    Raises a `MapFileError` if the resolution is not that of a building's map, a number is not finite or too large, or
    there are no cells or too many.
    """
    if not (np.isfinite(geometry.resolution) and geometry.resolution > 0.0):
        raise MapFileError(f"{path}: the resolution must be positive, got {geometry.resolution}: correct it")
    if not SMALLEST_CELL <= geometry.resolution <= LARGEST_CELL:
        raise MapFileError(
            f"{path}: cells of {geometry.resolution:g} m are not within {SMALLEST_CELL:g} to {LARGEST_CELL:g} m: "
            "correct the resolution"
        )
    if not np.isfinite([geometry.origin_x, geometry.origin_y]).all():
        raise MapFileError(
            f"{path}: the origin must be finite, got {geometry.origin_x}, {geometry.origin_y}: correct it"
        )
    check_size(path, geometry.rows, geometry.cols)
    farthest = max(abs(edge) for edge in geometry.bounds())
    if not farthest <= FARTHEST_PLACE:
        raise MapFileError(
            f"{path}: the map would reach to {farthest:.3g} m, more than the {FARTHEST_PLACE:.0e} m that are possible: "
            "correct the resolution and the origin"
        )


def check_size(path: str | os.PathLike[str], rows: int, cols: int) -> None:
    """Raise a `MapFileError` if there are no cells, or too many for a plausible map or for this machine."""
    if rows < 1 or cols < 1:
        raise MapFileError(f"{path}: a map of {rows} x {cols} cells is empty: make it again")
    if rows * cols > MAX_CELLS:
        raise MapFileError(
            f"{path}: {rows} x {cols} cells are more than the limit of {MAX_CELLS}: crop the map or use coarser cells"
        )
    needed, there = rows * cols * _BYTES_A_CELL, machine_memory()
    if needed > there:
        raise MapFileError(
            f"{path}: {rows} x {cols} cells take {needed / 1e9:.1f} GB of memory, and {there / 1e9:.1f} GB are "
            f"available: "
            "crop the map, use coarser cells or a larger machine"
        )


MAX_DISTANCE = 10_000.0
"""Largest plausible distance of a robot or a hit from the map [m]; algorithms would step over longer ones forever."""

MAX_TURN = 1000.0
"""Largest plausible angle of a file [rad]."""

MAX_LEVER = 1000.0
"""Largest plausible distance of a laser from its robot [m]."""


def stray_number(drive: Drive, geometry: GridGeometry) -> str | None:
    """Return an impossible value of a drive in a map of this geometry, as text; None if there is none."""
    keyframes = drive.keyframes
    min_x, min_y, max_x, max_y = geometry.bounds()
    low, high = np.array([min_x, min_y]), np.array([max_x, max_y])
    for what, poses in (("pose", drive.trajectory.poses), ("keyframe", keyframes.poses)):
        outside = np.maximum(low - poses[:, :2], poses[:, :2] - high)
        if (stray := _first(outside, MAX_DISTANCE)) is not None:
            x, y = poses[stray, :2]
            return f"a {what} lies at {x:.3g}, {y:.3g} m, more than {MAX_DISTANCE:.0f} m from the map"
    for what, moves in (("laser", keyframes.sensor_poses), ("beam", keyframes.beam_steps)):
        if (stray := _first(np.abs(moves[:, :2]), MAX_LEVER)) is not None:
            x, y = moves[stray, :2]
            return f"a {what} of the robot lies at {x:.3g}, {y:.3g} m, more than {MAX_LEVER:.0f} m from it"
    lengths = np.abs(keyframes.ranges)
    if (far := lengths[np.isfinite(lengths) & (lengths > MAX_DISTANCE)]).size:
        return f"a beam is {far[0]:.3g} m long, more than {MAX_DISTANCE:.0f} m"
    measured = [motions.steps for motions in (drive.motions, drive.closure_motions) if motions is not None]
    steps = np.concatenate([np.zeros((0, 3)), *measured])
    if (stray := _first(np.abs(steps[:, :2]), MAX_DISTANCE)) is not None:
        x, y = steps[stray, :2]
        return f"a step of the robot is {x:.3g}, {y:.3g} m, more than {MAX_DISTANCE:.0f} m"
    angles = (drive.trajectory.poses[:, 2:], keyframes.poses[:, 2:], keyframes.sensor_poses[:, 2:], steps[:, 2:])
    for turns in (*angles, keyframes.beam_steps[:, 2:], keyframes.beams[:, :2]):
        if (stray := _first(np.abs(turns), MAX_TURN)) is not None:
            return f"an angle is {np.abs(turns[stray]).max():.3g} rad, more than {MAX_TURN:.0f}"
    return None


def _first(values: FloatArray, limit: float) -> int | None:
    """Return the first row of values (N, C) with a value above a limit."""
    above = np.flatnonzero((values > limit).any(axis=1))
    return int(above[0]) if len(above) else None
