"""Whether a drive is one that no robot drives, as where scans were laid onto wrong surfaces one after the other."""

from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray, way_lengths
from tbmslam.kernels import IntArray

_SPAN_S, _STEP_S = 10.0, 1.0
"""Time over which a speed is taken, and time between the poses that tell it: noise of single poses is no speed."""
_FASTEST = 4.0
"""Robots that map buildings drive up to 2 m/s, and platforms for them 3 m/s at the most [m/s]."""
_CONFIRMED = 0.5
"""Share of the speed that odometry must tell for it to be true."""


class ImpossibleSpeed(NamedTuple):
    """The fastest part of a drive that no robot drives: when it begins [s], and how fast it is [m/s]."""

    stamp: float
    speed: float

    def warning(self) -> str:
        """Return what is said of it."""
        return (
            f"the robot would drive at {self.speed:.1f} m/s for {_SPAN_S:.0f} s, which no robot does: the map is wrong "
            "there, or ranges or stamps have another unit"
        )


def impossible_speed(
    stamps: FloatArray, poses: FloatArray, keyframe_stamps: FloatArray, odometry: FloatArray
) -> ImpossibleSpeed | None:
    """Return where a drive is faster than any robot; None where it is nowhere, or where odometry tells so as well.

    Parameters
    ----------
    stamps, poses
        Times (N,) [s], which may step back, and poses (N, 3) of the robot in the map.
    keyframe_stamps, odometry
        Times (K,) [s] and poses (K, 3) of the robot by odometry at keyframes; nan where there was none.
    """
    times = _running(stamps)
    # A pose a second, wherever there is one: a clock may have stepped over years.
    _, chosen = np.unique(np.floor(times / _STEP_S), return_index=True)
    begins, speeds = _speeds(times[chosen], poses[chosen])
    if not len(speeds):
        return None
    fastest = int(speeds.argmax())
    speed, stamp = float(speeds[fastest]), float(stamps[chosen[begins[fastest]]])
    if speed <= _FASTEST:
        return None
    told = np.flatnonzero((keyframe_stamps >= stamp) & (keyframe_stamps <= stamp + _SPAN_S))
    steps = np.hypot(*np.diff(odometry[told, :2], axis=0).T)
    if len(told) > 1 and np.nansum(steps) >= _CONFIRMED * speed * _SPAN_S:
        return None
    return ImpossibleSpeed(stamp, speed)


def _running(stamps: FloatArray) -> FloatArray:
    """Return times since the begin (N,) that never step back [s]."""
    steps = np.maximum(np.diff(stamps, prepend=stamps[:1]), 0.0)
    times: FloatArray = np.cumsum(steps)
    return times


def _speeds(times: FloatArray, poses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the poses (S,) from which a whole span is left, and the mean speeds (S,) over it [m/s]."""
    ways = way_lengths(poses)
    ends = np.searchsorted(times, times + _SPAN_S)
    begins = np.flatnonzero(ends < len(times))
    ends = ends[begins]
    speeds: FloatArray = (ways[ends] - ways[begins]) / (times[ends] - times[begins])
    return begins, speeds
