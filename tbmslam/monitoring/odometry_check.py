"""Checks that odometry and scans agree: wheels slip, counters jump, drivers freeze, and robots are carried.

A tracker weights the information of the odometry by its agreement with the pose of the scan (`ScanMatch.trust`).
It is normal that slip of the wheels reduces this weight in single scans. Long contradictions and contradictions after a
pause are reported.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, compose, inverse, stacked
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, informations
from tbmslam.tracking.tracker import PosePrior, ScanMatch


class OdometryCheckConfig(FrozenConfig):
    """When odometry and scans contradict each other."""

    keyframes: int = Field(4, ge=1, description="number of keyframes over which motions are compared")
    distance: float = Field(0.4, gt=0, description="difference that gives a warning [m]")
    angle: float = Field(0.4, gt=0, description="difference that gives a warning [rad]")
    per_metre: float = Field(0.25, ge=0, description="additional tolerance of both per metre")
    scale: float = Field(
        0.06, gt=0, description="relative difference of lengths over the whole drive that gives a warning"
    )
    lengths: int = Field(10, ge=1, description="least number of compared lengths of at least a metre")


class OdometryCheck:
    """Compares the motions by odometry and by scans."""

    def __init__(self, config: OdometryCheckConfig) -> None:
        self._config = config
        self._known: deque[tuple[SE2, SE2]] = deque(maxlen=config.keyframes + 1)

    def forget(self) -> None:
        """Compare no motion that began before now, since the odometry jumped."""
        self._known.clear()

    def disagrees(self, T_odom_robot: SE2 | None, T_map_robot: SE2) -> bool:
        """Return whether the motions since the oldest kept keyframe differ by too much."""
        if T_odom_robot is None:
            self._known.clear()
            return False
        self._known.append((T_odom_robot, T_map_robot))
        T_odom_first, T_map_first = self._known[0]
        by_wheels, by_scans = T_odom_first.to(T_odom_robot), T_map_first.to(T_map_robot)
        config, (x, y, heading) = self._config, by_scans
        more = config.per_metre * math.hypot(x, y)
        distance = math.hypot(by_wheels[0] - x, by_wheels[1] - y)
        angle = abs(math.remainder(by_wheels[2] - heading, 2.0 * math.pi))
        if distance <= config.distance + more and angle <= config.angle + more:
            return False
        self._known.clear()
        return True


_LENGTH, _LEAST = 1.0, 0.1
"""Least length of a compared section, and the length below which odometry or scans are at rest [m]."""
_DETERMINED = 0.5
"""Share of each step's length that scans must determine; below, odometry is compared with itself."""


def odometry_scale(keyframes: Sequence[TrackedKeyframe], wheels: FloatArray, scale: float, lengths: int) -> float:
    """Return the median ratio of the lengths by scans and by odometry; 1 if it gives no warning.

    The median is over many short sections, so occasional slip does not change it. A section counts only if the scans
    determine its length. In a featureless corridor, or if the laser sees hardly anything, scans follow the odometry.
    `wheels` (K, 3) are the poses of the robot by odometry at the keyframes, nan if unknown. A warning needs a relative
    difference of `scale`, and at least `lengths` sections.
    """
    if len(keyframes) < 2:
        return 1.0
    ends = stacked([keyframe.match.T_map_sensor for keyframe in keyframes])
    scans = compose(ends, inverse(stacked([keyframe.T_robot_sensor for keyframe in keyframes])))
    determined = _shares(keyframes, scans) >= _DETERMINED
    known = np.concatenate(([True], determined & ~np.isnan(wheels[1:, 0]) & ~np.isnan(wheels[:-1, 0]))).tolist()
    ratios, begin = [], (*wheels[0, :2].tolist(), *scans[0, :2].tolist())
    for is_known, here in zip(known, np.hstack((wheels[:, :2], scans[:, :2])).tolist(), strict=True):
        by_wheels = math.hypot(here[0] - begin[0], here[1] - begin[1])
        by_scans = math.hypot(here[2] - begin[2], here[3] - begin[3])
        if is_known and max(by_wheels, by_scans) < _LENGTH:
            continue
        begin = here
        if is_known and min(by_wheels, by_scans) >= _LEAST:  # else one of them stood still
            ratios.append(by_scans / by_wheels)
    ratio = float(np.median(ratios)) if len(ratios) >= lengths else 1.0
    return ratio if abs(math.log(ratio)) > math.log1p(scale) else 1.0


def _shares(keyframes: Sequence[TrackedKeyframe], poses: FloatArray) -> FloatArray:
    """Return the share of each step's length (K - 1,) that scans determine, beyond the prior.

    Poses (K, 3) are those of the robot. Without information from the tracker the share is 1.
    """
    if all(keyframe.match.information is None for keyframe in keyframes):
        return np.ones(len(keyframes) - 1)
    seen, before = informations(keyframes)
    ahead = np.zeros((len(keyframes) - 1, 3))
    ahead[:, :2] = np.diff(poses[:, :2], axis=0)
    prior, posterior = (
        np.einsum("ki,ki->k", ahead, np.linalg.solve(information, ahead[:, :, None])[:, :, 0])
        for information in (before, before + seen)
    )
    shares: FloatArray = 1.0 - posterior / np.maximum(prior, 1e-300)
    return shares


_CONTRADICTED = 0.02  # trust below which a scan contradicts the odometry: 18 deviations off
_PAUSE_S = 1.5  # a pause in which a robot may have been carried [s]
_STOOD_M = 0.3  # in a pause the wheels may slip by less while the robot is lifted [m]
_WHILE_S = 2.0  # time for which scans contradict the odometry before it is reported [s]

DISAGREE = "odometry and scans disagree about the motion"
ELSEWHERE = (
    "after a pause the scan shows another place, but the odometry hardly moved: if the robot was carried, "
    "split the recording there with --interval"
)
BEGAN_ANEW = "after a pause the odometry is at its origin, but the scan shows the place before: the odometry began anew"


class Contradictions:
    """Follows the trust in the odometry from scan to scan; only this notices a laser that repeats one scan."""

    def __init__(self) -> None:
        self._last, self._since = -math.inf, math.inf
        self._from = SE2.identity()

    def message_of(self, stamp: float, match: ScanMatch, prior: PosePrior) -> str:
        """Return the warning for a scan at a stamp [s] and its match; "" if there is none."""
        pause, self._last = stamp - self._last, stamp
        before, self._from = self._from, prior.start
        if match.trust >= _CONTRADICTED or not (prior.by_odometry and match.moved):
            self._since = math.inf
            return ""
        stood = math.hypot(prior.start.x - before.x, prior.start.y - before.y) < _STOOD_M
        if stood and _PAUSE_S < pause < math.inf:
            self._since = stamp
            return ELSEWHERE
        self._since = min(self._since, stamp)
        return DISAGREE if stamp - self._since >= _WHILE_S else ""


_NEAR, _NEAR_SHARE = 0.15, 0.03
"""Largest distance between two hits of one surface [m], and its increase per metre of range."""
_FEWEST = 10
_FARTHEST = 40.0  # hits beyond are left out, as the tracker leaves them out [m]


def agreeing_share(before: LaserScan, after: LaserScan, T_before_after: SE2) -> float:
    """Return the share of a scan's hits that the next scan confirms, of those in its view; 1 if few are in view."""
    points = T_before_after.inverse().apply(before.hits(_FARTHEST).points)
    step, beams = after.angle_increment, len(after.ranges)
    if not len(points) or not beams or step == 0.0:
        return 1.0
    ranges, angles = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    turned = (angles - after.angle_min) * np.sign(step) + 0.5 * abs(step)
    beam = (np.remainder(turned, 2.0 * np.pi) / abs(step)).astype(np.int64)
    there = np.where(beam < beams, after.ranges[np.minimum(beam, beams - 1)], np.nan)
    known = ~np.isnan(there)
    if np.count_nonzero(known) < _FEWEST:
        return 1.0
    return float(np.mean(np.abs(there[known] - ranges[known]) <= _NEAR + _NEAR_SHARE * ranges[known]))
