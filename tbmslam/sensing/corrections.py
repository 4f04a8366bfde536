"""What was changed in readings as they were read."""

from typing import NamedTuple


class Corrections(NamedTuple):
    """What somebody had changed, so that a warning can name what is to be done instead.

    Parameters
    ----------
    range_offset
        Added to every range that was measured [m].
    odometry_scale
        What the odometry's lengths were multiplied by.
    """

    range_offset: float = 0.0
    odometry_scale: float = 1.0
