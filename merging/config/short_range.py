"""What counts as short range."""

from typing import ClassVar

from tbmslam.frozen_config import FrozenConfig, Metres


class ShortRangeConfig(FrozenConfig):
    """A second registration, by short ranges only, of maps that no alignment joined; see `merging.short_range`.

    Parameters
    ----------
    enabled
        Whether it is tried where maps carry keyframes.
    range_m
        Walls seen from farther off are left out [m]: from here a heading that is wrong by a degree moves a wall as far
        as walls that agree may lie from each other.
    """

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = True
    range_m: Metres = 8.5
