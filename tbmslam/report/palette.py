"""Colours for values: a picture of few colours is small, and a colour can be read back as its value."""

import io
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray

Colour = tuple[int, int, int]
Levels = npt.NDArray[np.uint8]

STEPS = 20
"""Values from 0 to 1 are shown in steps of a twentieth."""


@dataclass(frozen=True)
class Palette:
    """The colours of the levels 0, 1, 2, ... of a picture.

    Parameters
    ----------
    colours
        Red, green and blue of every level; no two are the same, so that a level can be told by its colour.
    alphas
        How opaque the first levels are, 0 to 255; the others are opaque.
    """

    colours: tuple[Colour, ...]
    alphas: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check that levels can be told apart."""
        if len(set(self.colours)) < len(self.colours) or len(self.colours) > 256:
            raise ValueError(f"colours must be at most 256 and differ, got {self.colours}")

    @classmethod
    def ramp(cls, *stops: Colour, alphas: tuple[int, ...] = ()) -> "Palette":
        """Return `STEPS` + 1 colours that run evenly from the first stop over the others to the last."""
        at = np.linspace(0.0, len(stops) - 1.0, STEPS + 1)
        channels = [np.rint(np.interp(at, np.arange(len(stops)), values)) for values in zip(*stops, strict=True)]
        return cls(tuple((int(r), int(g), int(b)) for r, g, b in zip(*channels, strict=True)), alphas)

    def png(self, levels: Levels) -> bytes:
        """Return a picture (rows, cols) of levels as PNG; its first row is the top."""
        from PIL import Image  # noqa: PLC0415  # slow to load, and only reports need it

        picture = Image.fromarray(levels)
        picture.putpalette(bytes(channel for colour in self.colours for channel in colour))
        content = io.BytesIO()
        more = {"transparency": bytes(self.alphas)} if self.alphas else {}
        picture.save(content, "png", compress_level=6, **more)  # 9 saves a fifteenth of the size in 8 times the time
        return content.getvalue()


def levels_of(values: npt.NDArray[np.floating] | FloatArray) -> Levels:
    """Return shares (rows, cols) from 0 to 1 as levels of a ramp."""
    return np.rint(np.clip(values, 0.0, 1.0) * STEPS).astype(np.uint8)
