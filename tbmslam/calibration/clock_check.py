"""A check of the clocks: how much older the odometry is than the scan with which it is combined."""

from tbmslam.calibration.hand_eye import SensorPlace

_LAG = 0.12
"""Lag that causes a warning [s]. It is -0.10 to 0.04 s in the drives mit-csail, aces, intel and fr-clinic, whose errors
do not change by 3 % with another 0.15 s. Lasers that see little err by up to half a metre more with 0.15 s."""
_SURE = 4.0
"""Standard deviations within which the lag must be known to that limit."""


def clock_warning(place: SensorPlace | None) -> str | None:
    """Return a warning if the stamps of odometry and scans do not fit together, else None."""
    if place is None or abs(place.lag) < _LAG or _SURE * place.lag_deviation > _LAG:
        return None
    return (
        f"the clocks of odometry and scans differ by {abs(place.lag):.2f} s: "
        f"try --clock-offset {place.lag:.2f} (add it to the offset in use, if any)"
    )
