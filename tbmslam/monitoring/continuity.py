"""Whether a scan goes on where the last one was: two scans tell free space, and a wrong pose puts walls into it."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.shut_in import ShutInConfig
from tbmslam.se2 import SE2, FloatArray

_FEWEST_HITS = 20


class ContinuityConfig(FrozenConfig):
    """When a robot that drove on is told from one that was carried elsewhere."""

    enabled: bool = Field(True, description="look for moments at which the robot got lost; surfels only")
    doubtful: float = Field(0.5, ge=0, le=1, description="share of hits on known surfaces below which to look")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are not compared [m]")
    depth: float = Field(0.3, gt=0, description="how far a hit must lie in free space to contradict [m]")
    max_contradiction: float = Field(
        0.12, ge=0, le=1, description="share of both scans' hits in the other's free space that is no continuation"
    )
    max_agreement: float = Field(
        0.4,
        ge=0,
        le=1,
        description="a scan with more of its hits on what the last scan hit is a continuation all the same",
    )
    far: float = Field(0.3, gt=0, description="a scan placed so far from where the odometry puts it [m, rad]")
    min_agreement: float = Field(
        0.7, ge=0, le=1, description="must have this share of its hits on what the last scan hit"
    )
    elsewhere: float = Field(
        0.3,
        ge=0,
        le=1,
        description="a scan with less of its hits on what the last scan hit, and max_change in its free space, is none",
    )
    pause: float = Field(1.5, gt=0, description="after so long without a scan a robot may have been carried [s]")
    still: float = Field(0.15, gt=0, description="it stood still meanwhile if its odometry moved no farther [m, rad]")
    max_change: float = Field(
        0.05,
        ge=0,
        le=1,
        description="share of both scans' hits in the other's free space that is told after such a pause",
    )
    max_near_change: float = Field(0.04, ge=0, le=1, description="the same share of what is near")
    niche: float = Field(0.1, gt=0, description="for which so little counts, as deep as doors [m]")
    near: float = Field(10.0, gt=0, description="and only hits within this [m]")
    shift: float = Field(
        0.03, gt=0, description="so far from where its odometry puts it, it was moved in the pause [m]"
    )
    turn: float = Field(0.01, gt=0, description="or turned so much from there [rad]")
    slack: float = Field(0.3, ge=0, description="more of both per metre or radian that its odometry did move")
    shut_in: ShutInConfig = ShutInConfig()


class Comparison(NamedTuple):
    """How two scans at poses go together.

    Parameters
    ----------
    contradiction
        Share of hits in what the other scan saw free, the smaller of both shares: people before the laser put many of
        one scan's hits there, but none of the other's.
    agreement
        Share of hits on what the other scan hit, the smaller of both.
    """

    contradiction: float
    agreement: float


def compare_scans(before: LaserScan, after: LaserScan, T_before_after: SE2, config: ContinuityConfig) -> Comparison:
    """Compare two scans, the second of which was taken at a pose seen from the first."""
    one = _shares(before, after, T_before_after, config)
    other = _shares(after, before, T_before_after.inverse(), config)
    return Comparison(min(one[0], other[0]), min(one[1], other[1]))


def changed_share(before: LaserScan, after: LaserScan, T_before_after: SE2, config: ContinuityConfig) -> float:
    """Return how much of what is near changed between two scans taken at nearly one place, the smaller of both shares.

    There a hit in front of all three beams next to it stands where nothing was, though doors and niches are not deep.
    """
    one = _beyond(before, after, T_before_after, config.near, 1)
    other = _beyond(after, before, T_before_after.inverse(), config.near, 1)
    return min(_share(one > config.niche), _share(other > config.niche))


def _shares(seeing: LaserScan, seen: LaserScan, T_seeing_seen: SE2, config: ContinuityConfig) -> tuple[float, float]:
    """Return the shares of a scan's hits in another's free space and on its hits."""
    beyond = _beyond(seeing, seen, T_seeing_seen, config.max_range, 0)
    return _share(beyond > config.depth), _share(np.abs(beyond) <= config.depth)


def _share(those: npt.NDArray[np.bool_]) -> float:
    return float(np.mean(those)) if len(those) >= _FEWEST_HITS else 0.0


def _beyond(seeing: LaserScan, seen: LaserScan, T_seeing_seen: SE2, reach: float, beside: int) -> FloatArray:
    """Return how far one scan's beams went on behind the hits (M,) of another, the nearest of some neighbours [m]."""
    if seeing.angle_increment == 0.0:  # a single beam
        return np.zeros(0)
    points = T_seeing_seen.apply(seen.hit_points(reach))
    distances = np.hypot(points[:, 0], points[:, 1])
    turns = (np.arctan2(points[:, 1], points[:, 0]) - seeing.angle_min) * np.sign(seeing.angle_increment)
    beams = np.round(turns % (2.0 * math.pi) / abs(seeing.angle_increment)).astype(np.int64)
    inside = (beams >= beside) & (beams < len(seeing.ranges) - beside)
    around = [seeing.ranges[beams[inside] + shift] for shift in range(-beside, beside + 1)]
    ranges = np.where(np.isfinite(around).all(axis=0), np.min(around, axis=0), np.nan)
    beyond: FloatArray = (ranges - distances[inside])[np.isfinite(ranges)]
    return beyond
