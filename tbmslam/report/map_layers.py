"""The layers of a map: its masses, its drives, and their incidents."""

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, Masses, pignistic
from tbmslam.geometry.se2 import FloatArray, path_lengths
from tbmslam.map.drive import Drive
from tbmslam.report.sheet import Colour, Kind, Levels, Marks, Palette, Raster, Switch, levels_of

ROBOT_COLOURS: tuple[Colour, ...] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (148, 103, 189),
    (140, 86, 75),
    (128, 128, 0),
    (63, 40, 140),
    (20, 92, 60),
    (240, 128, 128),
)
"""Red, green, blue of each robot, repeated for more robots. Colour-blind readers can distinguish most (Okabe, Ito)."""

MOST_CELLS = 9_000_000
"""Larger pictures are shown in coarser cells: a browser needs four bytes for each, in every layer."""

_BAND = 256  # rows of cells that are computed at once, to limit the memory

_WHITE, _UNSEEN, _INK = (255, 255, 255), (204, 210, 217), (24, 28, 34)
_STEP = 0.05
_PIGNISTIC = Palette.ramp(_WHITE, _UNSEEN, _INK)
_MASSES = (
    ("occupied", OCCUPIED, Palette.ramp(_WHITE, (104, 124, 166), (16, 24, 60)), "mass on occupied: walls"),
    ("free", FREE, Palette.ramp(_WHITE, (120, 190, 150), (0, 92, 56)), "mass on free"),
    ("unknown", UNKNOWN, Palette.ramp(_WHITE, (226, 222, 210), (150, 140, 120)), "mass on unknown: no evidence"),
    ("conflict", CONFLICT, Palette.ramp(_WHITE, (240, 140, 120), (160, 0, 20)), "mass on conflict: scans contradict"),
)
_LINE_STEP = 0.5  # points of a trajectory that are nearer to each other than this share of a cell are left out

MAP = "Map"


def map_layers(grid: TbmGrid) -> list[Raster]:
    """Return the pignistic picture and each mass; one of them is shown at a time."""
    geometry, masses = for_display(grid.geometry, grid.masses_of_rows)
    switch = Switch(MAP, "pignistic", only_one=True, shown=True, note="probability of being occupied; 0.5 is unknown")
    layers = [Raster(switch, geometry, _pignistic_levels(masses), _PIGNISTIC, _STEP)]
    for name, subset, palette, note in _MASSES:
        switch = Switch(MAP, name, only_one=True, note=note)
        layers.append(Raster(switch, geometry, levels_of(masses[..., subset]), palette, _STEP))
    return layers


def _pignistic_levels(masses: Masses) -> Levels:
    levels = np.empty(masses.shape[:2], dtype=np.uint8)
    for first in range(0, len(masses), _BAND):
        levels[first : first + _BAND] = levels_of(pignistic(masses[first : first + _BAND]))
    return levels


def for_display(geometry: GridGeometry, cells_of_rows: Callable[[int, int], Masses]) -> tuple[GridGeometry, Masses]:
    """Return cells (rows, cols, ...), averaged over blocks if there are more than `MOST_CELLS`.

    `cells_of_rows` returns the cells (K, cols, ...) of the rows from the first up to, and without, the last.
    """
    block = int(np.ceil(np.sqrt(geometry.rows * geometry.cols / MOST_CELLS)))
    if block <= 1:
        return geometry, cells_of_rows(0, geometry.rows)
    rows, cols = -(-geometry.rows // block), -(-geometry.cols // block)
    below, right = rows * block - geometry.rows, cols * block - geometry.cols
    coarse, step = [], max(_BAND // block, 1)
    for first in range(0, rows, step):
        last = min(first + step, rows)
        band = cells_of_rows(first * block, min(last * block, geometry.rows))
        padded = cv2.copyMakeBorder(band, 0, below if last == rows else 0, 0, right, cv2.BORDER_REPLICATE)
        coarse.append(cv2.resize(padded, (cols, last - first), interpolation=cv2.INTER_AREA))
    return geometry._replace(resolution=geometry.resolution * block, rows=rows, cols=cols), np.concatenate(coarse)


def drive_layers(drives: Sequence[Drive], colours: Sequence[Colour], group: str, resolution: float) -> list[Marks]:
    """Return every drive's path, keyframes and closed loops in its colour, with switches in a group.

    `resolution` is the size of a cell of the map below them [m].
    """
    layers: list[Marks] = []
    for drive, colour in zip(drives, colours, strict=True):
        keyframes = drive.keyframes.poses[:, :2]
        columns: list[tuple[str, Kind, FloatArray]] = [
            ("drive", "line", _thinned(drive.trajectory.poses[:, :2], _LINE_STEP * resolution)),
            ("key\u00adframes", "dots", keyframes),
            ("loops", "links", keyframes[drive.closures].reshape(-1, 2)),
        ]
        for column, kind, points in columns:
            switch = Switch(group, drive.name, column, shown=kind == "line", note=_NOTES[column])
            layers.append(Marks(switch, kind, points, colour))
    return layers


def incident_layer(drive: Drive, incidents: object, group: str) -> list[Marks]:
    """Return the positions of the robot at the incidents of a drive; empty if there are none.

    `incidents` are those of run.json: objects with `stamp` [s], `at_s` [s], `what` and `all_along`. Others are ignored.
    """
    listed = incidents if isinstance(incidents, list | tuple) else []
    known = [one for one in listed if isinstance(one, Mapping) and isinstance(one.get("stamp"), int | float)]
    if not known or not len(drive.trajectory):
        return []
    stamps = drive.trajectory.stamps  # not sorted where the clock stepped back
    nearest = [int(np.argmin(np.abs(stamps - float(one["stamp"])))) for one in known]
    switch = Switch(
        group, drive.name, "inci\u00addents", shown=True, note="incidents of the drive; point at a dot to read its text"
    )
    texts = [
        f"{_time_of(one, float(stamps[index] - stamps[0]))}: {one.get('what')}"
        for one, index in zip(known, nearest, strict=True)
    ]
    return [Marks(switch, "dots", drive.trajectory.poses[nearest, :2], _INCIDENT, texts)]


def _time_of(incident: Mapping[str, object], since_start: float) -> str:
    """Return the time of an incident since the begin of the recording, or else since the begin of the drive."""
    if incident.get("all_along") is True:
        return "all along"
    at_s = incident.get("at_s")
    return f"{float(at_s) if isinstance(at_s, int | float) else since_start:.1f} s"


_INCIDENT: Colour = (200, 0, 30)
_NOTES = {
    "drive": "the path of the robot",
    "key\u00adframes": "positions of the scans that the map is rendered from",
    "loops": "loop closures: places that were seen at different times",
}


def _thinned(points: FloatArray, step: float) -> FloatArray:
    """Return points (K, 2) about a step apart [m], including the first and the last."""
    if len(points) < 3:
        return points
    _, first = np.unique((path_lengths(points) / step).astype(np.int64), return_index=True)
    return np.asarray(points[np.union1d(first, [len(points) - 1])])
