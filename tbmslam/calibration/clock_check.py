"""A check of the clocks: how much older the odometry is than the scan with which it is combined."""

from tbmslam.calibration.hand_eye import SensorPlace

_LAG = 0.12
"""Lag that causes a warning [s]. The hand-eye calibration finds -0.10 to 0.04 s in mit-csail, aces, intel and
fr-clinic, whose errors change by at most 3 % with another 0.15 s."""
_SURE = 4.0
"""A lag is reported only if this many of its standard deviations are below that limit."""


def clock_warning(place: SensorPlace, offset: float) -> str | None:
    """Return a warning if the odometry is older or newer than the scans, else None.

    `offset` is the time that was added to the stamps of the scans before odometry was looked up [s].
    """
    if abs(place.lag) < _LAG or _SURE * place.lag_deviation > _LAG:
        return None
    return (
        f"the odometry is {abs(place.lag):.2f} s {'older' if place.lag > 0.0 else 'newer'} than the scans: "
        f"try --clock-offset {offset + place.lag:.2f}"
    )
