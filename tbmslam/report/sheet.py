"""A map in the report: layers in one frame, in metres, and robots that move along their drives."""

import base64
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import FloatArray, path_lengths, wrap_angles
from tbmslam.map.drive import Drive

Kind = Literal["line", "dots", "links"]
Colour = tuple[int, int, int]
Levels = npt.NDArray[np.uint8]

STEPS = 20
"""Values from 0 to 1 are shown in steps of a twentieth."""

_INDEXED = 3  # a PNG's colour type whose pixels are numbers of colours of a palette


@dataclass(frozen=True)
class Palette:
    """The colours of the levels 0, 1, 2, ... of a picture."""

    colours: tuple[Colour, ...]
    """Red, green and blue of every level; all differ, so that a colour identifies its level."""
    alphas: tuple[int, ...] = ()
    """Opacity of the first levels, 0 to 255; the others are opaque."""

    def __post_init__(self) -> None:
        """Check that the colours identify the levels."""
        if len(set(self.colours)) < len(self.colours) or len(self.colours) > 256:
            raise ValueError(f"colours must be at most 256 and differ, got {self.colours}")

    @classmethod
    def ramp(cls, *stops: Colour, alphas: tuple[int, ...] = ()) -> "Palette":
        """Return `STEPS` + 1 colours that run evenly from the first stop over the others to the last."""
        at = np.linspace(0.0, len(stops) - 1.0, STEPS + 1)
        channels = [np.rint(np.interp(at, np.arange(len(stops)), values)) for values in zip(*stops, strict=True)]
        return cls(tuple((int(r), int(g), int(b)) for r, g, b in zip(*channels, strict=True)), alphas)

    def png(self, levels: Levels) -> bytes:
        """Return a picture (rows, cols) of levels as PNG; its first row is the top.

        OpenCV writes no pictures with palettes, which need a third of the bytes here. The chunks are those of the W3C's
        Portable Network Graphics Specification, section 11.
        """
        rows, cols = levels.shape
        lines = np.zeros((rows, cols + 1), dtype=np.uint8)  # each begins with its filter, 0 for none
        lines[:, 1:] = levels
        chunks = [
            (b"IHDR", struct.pack(">IIBBBBB", cols, rows, 8, _INDEXED, 0, 0, 0)),
            (b"PLTE", bytes(channel for colour in self.colours for channel in colour)),
            *([(b"tRNS", bytes(self.alphas))] if self.alphas else []),
            (b"IDAT", zlib.compress(lines.data, 6)),  # 9 saves a fifteenth of the size in 8 times the time
            (b"IEND", b""),
        ]
        return b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
            for name, content in chunks
        )


def levels_of(values: npt.NDArray[np.floating] | FloatArray) -> Levels:
    """Return shares (rows, cols) from 0 to 1 as levels of a ramp."""
    return np.rint(np.clip(values, 0.0, 1.0) * STEPS).astype(np.uint8)


_STEP_M = 0.1  # largest error of the shown position, except on drives with more steps than `_MOST_STEPS`
_ARM_M = 0.5  # a rotation counts as the path of a point at this distance from the robot: 0.1 m are 11 degrees
_MOST_STEPS, _MOST_STEPS_OF_ALL, _LEAST_STEPS = 1000, 10_000, 20
"""Numbers of steps of a drive, and of all drives of a sheet. A step takes 40 bytes in the page."""


@dataclass(frozen=True)
class DriveTrack:
    """A drive over time as a few poses with linear motion between them."""

    label: str
    """The name of the robot, as on the switch of the drive."""
    colour: Colour
    """Red, green, blue."""
    times: FloatArray
    """Time since the begin of the drive (K,), non-decreasing [s]."""
    poses: FloatArray
    """Poses (K, 3): x [m], y [m], theta [rad]."""

    def as_json(self) -> dict[str, object]:
        """Return the JSON for the page's script: rows of tenths of a second, x and y in centimetres, and degrees."""
        degrees = np.degrees(wrap_angles(self.poses[:, 2]))
        rows = np.column_stack((10.0 * self.times, 100.0 * self.poses[:, :2], degrees))
        red, green, blue = self.colour
        return {
            "label": self.label,
            "colour": f"rgb({red}, {green}, {blue})",
            "rows": np.rint(rows).astype(np.int64).tolist(),
        }


def drive_tracks(drives: Sequence[Drive], colours: Sequence[Colour]) -> tuple[DriveTrack, ...]:
    """Return the tracks of drives; drives without duration have none.

    If the clock of the recorder stepped back, the stamps are not usable. The scans are then spread evenly over time.
    """
    most = max(min(_MOST_STEPS, _MOST_STEPS_OF_ALL // max(len(drives), 1)), _LEAST_STEPS)
    tracks = []
    for drive, colour in zip(drives, colours, strict=True):
        stamps, poses = drive.trajectory.stamps, drive.trajectory.poses
        if not len(stamps) or stamps.max() <= stamps.min():
            continue
        times = stamps - stamps[0]
        if (np.diff(stamps) < 0.0).any():
            times = np.linspace(0.0, float(stamps.max() - stamps.min()), len(stamps))
        kept = _kept(poses, most)
        tracks.append(DriveTrack(drive.name, colour, times[kept], poses[kept]))
    return tuple(tracks)


def _kept(poses: FloatArray, most: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return indices of the first and the last pose of each step; both, since a robot may rest long within a step."""
    turned = np.zeros(len(poses))
    np.cumsum(np.abs(wrap_angles(np.diff(poses[:, 2]))), out=turned[1:])
    moved = path_lengths(poses) + _ARM_M * turned
    step = max(_STEP_M, float(moved[-1]) / most)
    ends = np.flatnonzero(np.diff((moved / step).astype(np.int64)))
    return np.unique(np.concatenate(([0], ends, ends + 1, [len(poses) - 1])))


@dataclass(frozen=True)
class Switch:
    """The switch of a layer."""

    group: str
    """The heading of the group of switches."""
    label: str
    """The name of the layer, or the name of the robot in a group with columns."""
    column: str = ""
    """The name of the layer in a group with columns."""
    only_one: bool = False
    """Whether at most one layer of the group is shown at a time."""
    shown: bool = False
    note: str = ""

    def as_json(self) -> dict[str, object]:
        """Return the JSON for the page's script."""
        return dict(vars(self))


@dataclass(frozen=True)
class Raster:
    """A picture of cells."""

    switch: Switch
    geometry: GridGeometry
    levels: Levels
    """A level of the palette for every cell (rows, cols); the first row has the smallest y."""
    palette: Palette
    unit: float | None = None
    """The value of one level, which the page shows at the cursor; None to show no value."""
    opacity: float = 1.0

    def as_json(self) -> dict[str, object]:
        """Return the JSON for the page's script, with the picture as a data URL."""
        left, bottom, right, top = self.geometry.bounds()
        png = self.palette.png(np.ascontiguousarray(self.levels[::-1]))
        red, green, blue = self.palette.colours[-1]
        return {
            **self.switch.as_json(),
            "kind": "raster",
            # That of the robot, where a row of switches is one robot.
            "colour": f"rgb({red}, {green}, {blue})" if self.switch.column else None,
            "bounds": [[bottom, left], [top, right]],
            "image": "data:image/png;base64," + base64.b64encode(png).decode("ascii"),
            "colours": [list(colour) for colour in self.palette.colours] if self.unit is not None else None,
            "unit": self.unit,
            "opacity": self.opacity,
        }


@dataclass(frozen=True)
class Marks:
    """Points in one colour."""

    switch: Switch
    kind: Kind
    """A `line` through all points, `dots`, or `links` between the first and the second, the third and the fourth,
    ..."""
    points: FloatArray
    """Points (N, 2) [m]."""
    colour: Colour
    """Red, green, blue."""
    texts: Sequence[str] = ()
    """The text of each dot, which the page shows at the cursor; may be empty."""

    def as_json(self) -> dict[str, object]:
        """Return the JSON for the page's script, with coordinates rounded to millimetres."""
        red, green, blue = self.colour
        return {
            **self.switch.as_json(),
            "kind": self.kind,
            "points": np.round(self.points[:, ::-1], 3).tolist(),
            "colour": f"rgb({red}, {green}, {blue})",
            "texts": list(self.texts),
        }


@dataclass(frozen=True)
class Sheet:
    """A map with its layers."""

    title: str
    layers: tuple[Raster | Marks, ...] = field(default_factory=tuple)
    """The layers, the lowest first."""
    note: str = ""
    tracks: tuple[DriveTrack, ...] = ()

    def as_json(self) -> dict[str, object]:
        """Return the JSON for the page's script."""
        return {
            "title": self.title,
            "layers": [layer.as_json() for layer in self.layers],
            "tracks": [track.as_json() for track in self.tracks],
        }
