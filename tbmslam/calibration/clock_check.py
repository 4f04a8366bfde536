"""A check of the clocks: how much older the odometry is than the scan with which it is combined."""

from tbmslam.calibration.hand_eye import Lag, SensorPlace

_LAG = 0.12
"""Lag that causes a warning [s]. The hand-eye calibration finds -0.10 to 0.04 s in mit-csail, aces, intel and
fr-clinic, whose errors change by at most 3 % with another 0.15 s."""
_SURE = 4.0
"""A lag is reported only if this many of its standard deviations are below that limit."""
_SURE_TURNS = 3.0
"""The same for the lag by rotations. Its deviation is 0.035 s in a drive of a Neato of 54 s, where it is right."""


def is_late(place: SensorPlace) -> bool:
    """Return whether the odometry surely is older or newer than the scans, by the calibration of the laser's pose."""
    return abs(place.lag) >= _LAG and _SURE * place.lag_deviation <= _LAG


def clock_warning(place: SensorPlace, turned: Lag | None, offset: float) -> str | None:
    """Return a warning if the odometry is older or newer than the scans, else None.

    `turned` is the lag by rotations alone. It is used if it is certain and has the sign of the lag of `place`, since
    that falls short where late odometry displaced the scans. `offset` is the time that was added to the stamps of the
    scans before odometry was looked up [s].
    """
    lag = place.lag
    if turned is not None and _SURE_TURNS * turned.deviation <= _LAG and turned.seconds * place.lag > 0.0:
        lag = turned.seconds
    if not is_late(place) or abs(lag) < _LAG:
        return None
    return (
        f"the odometry is {abs(lag):.2f} s {'older' if lag > 0.0 else 'newer'} than the scans: "
        f"try --clock-offset {offset + lag:.2f}"
    )
