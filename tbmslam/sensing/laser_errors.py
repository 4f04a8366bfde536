"""What is wrong with the numbers that a laser is described by, as the walls it saw tell it."""

from typing import NamedTuple


class LaserErrors(NamedTuple):
    """Errors of a laser's description, and how well they are known."""

    scale: float
    """Share by which the angles between beams are larger than stated."""
    scale_deviation: float
    """Standard deviation of `scale`."""
    offset: float
    """What is to be added to every range [m]."""
    offset_deviation: float
    """Standard deviation of `offset` [m]."""
