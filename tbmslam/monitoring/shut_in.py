"""A robot that stands where all is near, as in a lift: whether what it sees when it comes out was there before."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.place_before import Contrast, PlaceBefore, PlaceBeforeConfig, View
from tbmslam.monitoring.way_in import is_shut
from tbmslam.se2 import SE2

_EVERY = 0.5  # [s]
_MOST_SEEN = 400  # a robot that turns and turns goes no way
_STANDING = 2.0  # a robot that drives has left by then where it was [s]


class ShutInConfig(FrozenConfig):
    """When a robot counts as shut in, and when as come out elsewhere."""

    enabled: bool = Field(True, description="look for lifts that took the robot to another floor; surfels only")
    near: float = Field(4.0, gt=0, description="a robot is shut in where its laser sees no farther [m]")
    share: float = Field(0.05, ge=0, le=1, description="but for this share of the beams, as mirrors and gaps let pass")
    still: float = Field(0.5, gt=0, description="while it stands, turning or not, within this [m]")
    seconds: float = Field(10.0, gt=0, description="for so long [s]")
    seconds_closed: float = Field(
        4.0, gt=0, description="or so long where a wall was seen to stand on the way on which it had come in [s]"
    )
    back: float = Field(20.0, gt=0, description="way before that is compared with the way after [m]")
    soon: float = Field(3.0, ge=0, description="way after it from which on both may be told apart [m]")
    ahead: float = Field(15.0, gt=0, description="way after it that is compared [m]")
    elsewhere: float = Field(2.0, gt=0, description="length of walls that contradict, both ways, for another place [m]")
    elsewhere_share: float = Field(0.05, gt=0, description="and that per length of walls that agree")
    doubtful: float = Field(0.6, gt=0, description="length of them that is told, but cuts nothing [m]")
    doubtful_share: float = Field(0.015, gt=0, description="and that per length of walls that agree")
    closed: float = Field(
        0.5, gt=0, le=1, description="share of all four that is enough where the way it came in was seen shut"
    )
    one_way: float = Field(2.0, gt=0, description="length that contradicts in one way only and is told there, too [m]")
    place: PlaceBeforeConfig = PlaceBeforeConfig()


class Stay(NamedTuple):
    """A time for which the robot was shut in.

    Parameters
    ----------
    since, until
        Stamps [s].
    T_map_robot
        Where.
    closed
        Whether a wall was seen to stand on the way on which it had come in.
    """

    since: float
    until: float
    T_map_robot: SE2
    closed: bool

    def middle(self) -> float:
        """Return the stamp at which a lift would have been between floors [s]."""
        return 0.5 * (self.since + self.until)

    def outweighs(self, other: "Stay") -> bool:
        """Tell whether this was rather a lift than another one."""
        return (self.closed, self.until - self.since) > (other.closed, other.until - other.since)


class ComingOut(NamedTuple):
    """What is known of a stay once the robot came out.

    Parameters
    ----------
    stay
        When it was shut in.
    elsewhere
        Whether it came out elsewhere; else it may have.
    differs
        Whether anything there differs from what was before. Where nothing does, only its having been shut in is known:
        floors may be alike.
    """

    stay: Stay
    elsewhere: bool
    differs: bool = True


class _Seen(NamedTuple):
    """A keyframe, and the way that the robot had gone by then [m]."""

    scan: LaserScan
    T_map_sensor: SE2
    T_map_robot: SE2
    way: float


class ShutIn:
    """Watches for a robot that is shut in, and for where it comes out.

    Parameters
    ----------
    config
        When it is shut in, and when it comes out elsewhere.

    Attributes
    ----------
    left
        The last time that it was for as long as a lift takes, once it is over.
    """

    def __init__(self, config: ShutInConfig) -> None:
        self._config = config
        self.left: Stay | None = None
        self._looked = -math.inf
        self._stay: Stay | None = None  # as long as it lasts
        self._past: tuple[Stay, PlaceBefore, float] | None = None  # the last that counts, and the way at its end
        self._seen: deque[_Seen] = deque(maxlen=_MOST_SEEN)
        self._way = 0.0

    def forget(self, before: float = math.inf) -> None:
        """Forget what was seen before a stamp [s]."""
        self._past = None
        self._seen = deque((seen for seen in self._seen if seen.scan.stamp >= before), _MOST_SEEN)

    def look(self, scan: LaserScan, T_map_sensor: SE2, T_map_robot: SE2) -> ComingOut | None:
        """Look at a scan, at two a second; where a stay ends, return what is known by then of the one before."""
        if 0.0 <= scan.stamp - self._looked < _EVERY:
            return None
        self._looked = scan.stamp
        stay, is_near = self._stay, self._is_near(scan)
        if stay is not None and is_near and _apart(stay.T_map_robot, T_map_robot) <= self._config.still:
            stands = scan.stamp - stay.since >= _STANDING
            closed = stay.closed or (stands and self._is_shut(scan, T_map_sensor, T_map_robot))
            self._stay = stay._replace(until=scan.stamp, closed=closed)
            return None
        self._stay = Stay(scan.stamp, scan.stamp, T_map_robot, closed=False) if is_near else None
        return None if stay is None else self._ended(stay)

    def note_keyframe(self, scan: LaserScan, T_map_sensor: SE2, T_map_robot: SE2) -> ComingOut | None:
        """Learn from a keyframe; return what is known by it of the last stay, if that is enough."""
        config = self._config
        if self._seen:
            self._way += _apart(self._seen[-1].T_map_robot, T_map_robot)
        self._seen.append(_Seen(scan, T_map_sensor, T_map_robot, self._way))
        while self._way - self._seen[0].way > config.back + config.ahead:
            self._seen.popleft()
        if self._past is None:
            return None
        _, place, left = self._past
        place.see(View.of(scan, T_map_sensor, config.place.reach))
        if self._way - left < config.soon:
            return None
        found = self._judged()
        if (found is not None and found.elsewhere) or self._way - left >= config.ahead:
            return self._concluded(found)
        return None

    def end(self) -> ComingOut | None:
        """Return what is known of the last stay at the end of the drive."""
        return self._concluded(self._judged())

    def _is_near(self, scan: LaserScan) -> bool:
        far, share = np.count_nonzero(scan.ranges > self._config.near), self._config.share
        if far > share * len(scan.ranges):  # mostly
            return False
        return bool(far <= share * np.count_nonzero(scan.ranges > 0.0) and np.isfinite(scan.ranges).any())

    def _ended(self, stay: Stay) -> ComingOut | None:
        """Begin to compare what was before a stay with what comes after it."""
        config = self._config
        if stay.until - stay.since < (config.seconds_closed if stay.closed else config.seconds):
            return None
        self.left = stay
        found = self._judged()
        is_decided = self._past is None or (found is not None and found.elsewhere)
        if not is_decided and self._past is not None and not stay.outweighs(self._past[0]):
            return None
        self._concluded(found)
        before = [k for k in self._seen if k.scan.stamp < stay.since and self._way - k.way <= config.back]
        if before:
            views = [View.of(k.scan, k.T_map_sensor, config.place.reach) for k in before]
            self._past = stay, PlaceBefore(views, stay.T_map_robot, config.place), self._way
        return found

    def _concluded(self, found: ComingOut | None) -> ComingOut | None:
        """Return what is known of the last stay and be done with it; elsewhere, what was before is no part of it."""
        self._past = None
        if found is not None and found.elsewhere:
            self.forget(found.stay.until)
        return found

    def _judged(self) -> ComingOut | None:
        """Return what is known of the last stay."""
        if self._past is None:
            return None
        config, (stay, place, left) = self._config, self._past
        contrast, enough = place.contrast(), config.closed if stay.closed else 1.0
        if _reaches(contrast, enough * config.elsewhere, enough * config.elsewhere_share):
            return ComingOut(stay, elsewhere=True)
        doubtful = _reaches(contrast, enough * config.doubtful, enough * config.doubtful_share)
        if doubtful or (stay.closed and max(contrast.standing, contrast.gone) >= config.one_way):
            return ComingOut(stay, elsewhere=False)
        if stay.closed and self._way - left >= config.soon:
            return ComingOut(stay, elsewhere=False, differs=False)
        return None

    def _is_shut(self, scan: LaserScan, T_map_sensor: SE2, T_map_robot: SE2) -> bool:
        """Tell whether a wall stands where the robot drove a little while ago."""
        near = self._config.near
        way = [seen.T_map_robot for seen in self._seen if self._way - seen.way <= 2.0 * near]
        return is_shut(way, scan, T_map_sensor, T_map_robot, near)


def _reaches(contrast: Contrast, length: float, share: float) -> bool:
    contradicting = contrast.contradicting()
    return contradicting >= length and contradicting >= share * contrast.agreeing


def _apart(first: SE2, second: SE2) -> float:
    return math.hypot(second.x - first.x, second.y - first.y)
