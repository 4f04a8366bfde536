"""What the pixels of a map's picture mean to map_server and nav2."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tbmslam.map.map_image import MapImage

Mode = Literal["trinary", "scale", "raw"]
Alpha = Literal["unknown", "average"]

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196
"""nav2's own saver says 0.25, and then the pixel 205 of unknown cells, 50/255 = 0.19608, is free when read again."""


@dataclass(frozen=True)
class PixelRule:
    """What a pixel's value means.

    Parameters
    ----------
    negate
        Whether white is occupied.
    occupied_threshold, free_threshold
        Occupancies above and below which a pixel counts as occupied and free.
    mode
        Free, occupied or unknown; occupancies in between as well; or the occupancy itself.
    alpha
        In trinary mode, whether what is not opaque is unknown, or alpha is averaged with the colours.
    """

    negate: bool = False
    occupied_threshold: float = OCCUPIED_THRESHOLD
    free_threshold: float = FREE_THRESHOLD
    mode: Mode = "trinary"
    alpha: Alpha = "unknown"

    @property
    def averages_alpha(self) -> bool:
        """Whether alpha is averaged with the colours."""
        return self.mode == "trinary" and self.alpha == "average"


def occupancy_of_image(image: MapImage, rule: PixelRule) -> npt.NDArray[np.int8]:
    """Return the occupancy (rows, cols) that map_server publishes: 0 to 100, -1 unknown; row grows with y.

    Colours are averaged. What is not opaque is unknown but in raw mode, as in nav2_map_server since pull request 5071
    (2025). Before, and in ROS 1, alpha was averaged with the colours in trinary mode: `alpha: average` in the yaml.
    """
    sums, white = image.channel_sum(with_alpha=rule.averages_alpha)
    # A pixel's occupancy depends on the sum of its channels alone: one value for each, looked up afterwards.
    occupancy = _occupancies(np.arange(white + 1), white, rule)[sums]
    if image.alpha is not None and rule.mode != "raw" and not rule.averages_alpha:
        occupancy[image.alpha < image.maximum] = -1
    return np.ascontiguousarray(occupancy[::-1])


def _occupancies(sums: npt.NDArray[np.int64], white: int, rule: PixelRule) -> npt.NDArray[np.int8]:
    if rule.mode == "raw":
        percent = np.floor(sums / white * 255.0 + 0.5)
        return np.where(percent <= 100.0, percent, -1.0).astype(np.int8)
    p = (sums if rule.negate else white - sums) / white
    low, high = rule.free_threshold, rule.occupied_threshold
    between = np.rint((p - low) / (high - low) * 100.0) if rule.mode == "scale" else -1.0
    return np.where(p > high, 100.0, np.where(p < low, 0.0, between)).astype(np.int8)
