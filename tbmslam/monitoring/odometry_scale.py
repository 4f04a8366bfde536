"""How many times as far as the odometry the scans went: one of them may have a wrong scale."""

import math
from collections.abc import Sequence

import numpy as np

from tbmslam.geometry.se2 import FloatArray, compose, inverse
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe

_LENGTH, _LEAST = 1.0, 0.1
"""Length from which on a way is compared, and below which one of both stood still [m]."""
_DETERMINED = 0.5
"""Share of each step's length that scans must determine; below, odometry is compared with itself."""


def odometry_scale(keyframes: Sequence[TrackedKeyframe], wheels: FloatArray, scale: float, lengths: int) -> float:
    """Return how many times as far as the odometry the scans went, mostly; 1 where that is worth no warning.

    The median of many short ways: wheels that slip now and then do not change it. Only ways count whose lengths the
    scans determine. In a corridor alike everywhere, or where the laser sees hardly anything, they follow the odometry.

    Parameters
    ----------
    keyframes
        Keyframes as the tracker left them.
    wheels
        Poses (K, 3) of the robot at them by odometry; nan where there was none.
    scale
        Share by which lengths must differ for a warning.
    lengths
        Ways that must be compared at least.
    """
    if len(keyframes) < 2:
        return 1.0
    ends = np.array([keyframe.match.T_map_sensor for keyframe in keyframes])
    scans = compose(ends, inverse(np.array([keyframe.T_robot_sensor for keyframe in keyframes])))
    determined = _shares(keyframes, scans) >= _DETERMINED
    told = np.concatenate(([True], determined & ~np.isnan(wheels[1:, 0]) & ~np.isnan(wheels[:-1, 0]))).tolist()
    ratios, begin = [], (*wheels[0, :2].tolist(), *scans[0, :2].tolist())
    for is_told, here in zip(told, np.hstack((wheels[:, :2], scans[:, :2])).tolist(), strict=True):
        by_wheels = math.hypot(here[0] - begin[0], here[1] - begin[1])
        by_scans = math.hypot(here[2] - begin[2], here[3] - begin[3])
        if is_told and max(by_wheels, by_scans) < _LENGTH:
            continue
        begin = here
        if is_told and min(by_wheels, by_scans) >= _LEAST:  # else one of them stood still
            ratios.append(by_scans / by_wheels)
    ratio = float(np.median(ratios)) if len(ratios) >= lengths else 1.0
    return ratio if abs(math.log(ratio)) > math.log1p(scale) else 1.0


def _shares(keyframes: Sequence[TrackedKeyframe], poses: FloatArray) -> FloatArray:
    """Return which share of each step's length (K - 1,) scans determine, against what was known before.

    Poses (K, 3) are those of the robot. Trackers that do not say are believed.
    """
    if all(keyframe.match.information is None for keyframe in keyframes):
        return np.ones(len(keyframes) - 1)
    unknown = np.zeros((3, 3))
    seen = np.array([unknown if k.match.information is None else k.match.information for k in keyframes[1:]])
    before = np.array([keyframe.prior for keyframe in keyframes[1:]])
    ahead = np.zeros((len(keyframes) - 1, 3))
    ahead[:, :2] = np.diff(poses[:, :2], axis=0)
    prior, posterior = (
        np.einsum("ki,ki->k", ahead, np.linalg.solve(information, ahead[:, :, None])[:, :, 0])
        for information in (before, before + seen)
    )
    shares: FloatArray = 1.0 - posterior / np.maximum(prior, 1e-300)
    return shares
