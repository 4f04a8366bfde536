"""What counts as short range."""

from tbmslam.frozen_config import FrozenConfig, Metres


class ShortRangeConfig(FrozenConfig):
    """How maps that no alignment joined are aligned once more; see `merging.short_range`.

    Parameters
    ----------
    enabled
        Whether they are, where maps carry keyframes.
    range_m
        Walls seen from farther off are left out [m]: from here a heading that is wrong by a degree moves a wall as far
        as walls that agree may lie from each other.
    """

    enabled: bool = True
    range_m: Metres = 8.5
