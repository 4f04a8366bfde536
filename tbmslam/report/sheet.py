"""A map to look at: layers over one frame, in metres, to be switched on and off."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tbmslam.belief.grid import GridGeometry
from tbmslam.geometry.se2 import FloatArray
from tbmslam.report.palette import Colour, Levels, Palette
from tbmslam.report.timed_way import TimedWay

Kind = Literal["line", "dots", "links"]


@dataclass(frozen=True)
class Switch:
    """Where a layer is switched on and off.

    Parameters
    ----------
    group
        Heading under which it stands.
    label
        What it is, or in a group with columns whose it is.
    column
        In groups that are tables, what it is.
    only_one
        Whether at most one layer of the group is shown at a time.
    shown
        Whether it is shown at first.
    note
        What is seen, in words.
    """

    group: str
    label: str
    column: str = ""
    only_one: bool = False
    shown: bool = False
    note: str = ""

    def as_json(self) -> dict[str, object]:
        """Return the fields by the names that the page's script knows."""
        return dict(vars(self))


@dataclass(frozen=True)
class Raster:
    """A picture of cells.

    Parameters
    ----------
    switch
        Where it is switched.
    geometry
        Where its cells lie.
    levels
        A level of the palette for every cell (rows, cols); the first row is the smallest y.
    palette
        The colours.
    unit
        What a level stands for, to be read at the cursor; None where there is nothing to read.
    opacity
        How opaque the whole is.
    """

    switch: Switch
    geometry: GridGeometry
    levels: Levels
    palette: Palette
    unit: float | None = None
    opacity: float = 1.0

    def as_json(self) -> dict[str, object]:
        """Return what the page's script needs, the picture as a data URL."""
        left, bottom, right, top = self.geometry.bounds()
        png = self.palette.png(np.ascontiguousarray(self.levels[::-1]))
        return {
            **self.switch.as_json(),
            "kind": "raster",
            "bounds": [[bottom, left], [top, right]],
            "image": "data:image/png;base64," + base64.b64encode(png).decode("ascii"),
            "colours": [list(colour) for colour in self.palette.colours] if self.unit is not None else None,
            "unit": self.unit,
            "opacity": self.opacity,
        }


@dataclass(frozen=True)
class Marks:
    """Points in one colour.

    Parameters
    ----------
    switch
        Where they are switched.
    kind
        A `line` through all points, `dots`, or `links` between the first and the second, the third and the fourth, ...
    points
        Points (N, 2) [m].
    colour
        Red, green, blue.
    texts
        What to say at each dot that the cursor is on; nothing where there are none.
    """

    switch: Switch
    kind: Kind
    points: FloatArray
    colour: Colour
    texts: Sequence[str] = ()

    def as_json(self) -> dict[str, object]:
        """Return what the page's script needs; coordinates in whole millimetres are exact enough."""
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
    """One map with its layers, the lowest first.

    Parameters
    ----------
    title
        What it is.
    layers
        What can be shown.
    note
        What to know about it, in a sentence.
    ways
        The drives over time.
    """

    title: str
    layers: tuple[Raster | Marks, ...] = field(default_factory=tuple)
    note: str = ""
    ways: tuple[TimedWay, ...] = ()

    def as_json(self) -> dict[str, object]:
        """Return what the page's script needs."""
        return {
            "title": self.title,
            "layers": [layer.as_json() for layer in self.layers],
            "ways": [way.as_json() for way in self.ways],
        }
