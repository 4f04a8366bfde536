"""Beams blocked by something on the robot: they end at the same near distance wherever the robot drives and turns."""

import math
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray
from tbmslam.kernels import BoolArray
from tbmslam.kernels.rays.blocked_beams import follow_beams
from tbmslam.monitoring.incidents import Incidents
from tbmslam.sensing.laser_scan import LaserScan

_MOST_TOLD = 3


class _Span(NamedTuple):
    """Beams, and the readings from `begin` until before `until` in which they were blocked."""

    begin: float
    until: float
    beams: IntArray


class BlockedSpans:
    """The readings in which beams were blocked, by index: their stamps may step back."""

    def __init__(self) -> None:
        self._ended: list[_Span] = []
        self._latest: dict[bytes, int] = {}  # the last span of the same beams
        self._bounds: FloatArray | None = None  # begin and end (S, 2) of the ended spans, made on demand

    def end(self, beams: BoolArray, since: FloatArray, index: float) -> None:
        """Note that beams (B,) are no longer blocked at a reading; they were blocked since readings (B,)."""
        for span in _spans(beams, since, index):
            self._bounds = None
            same = span.beams.tobytes()
            number = self._latest.get(same, -1)
            last = self._ended[number] if number >= 0 else None
            if last is not None and span.begin <= last.until and last.begin <= span.until:
                both = last._replace(begin=min(last.begin, span.begin), until=max(last.until, span.until))
                self._ended[number] = both
            else:
                self._latest[same] = len(self._ended)
                self._ended.append(span)

    def were_any(self) -> bool:
        """Return whether any span has ended."""
        return bool(self._ended)

    def cleared(self, scan: LaserScan, index: int, beams: BoolArray, since: FloatArray) -> LaserScan:
        """Return the scan of a reading without the beams that were blocked then; beams (B,) still are, as in `end`."""
        if self._bounds is None:
            self._bounds = np.array([span[:2] for span in self._ended], dtype=np.float64).reshape(-1, 2)
        at = np.flatnonzero((self._bounds[:, 0] <= index) & (index < self._bounds[:, 1]))
        still = (span for span in _spans(beams, since, math.inf) if span.begin <= index)
        hidden = np.zeros(len(scan.ranges), dtype=np.bool_)
        for span in (*(self._ended[number] for number in at.tolist()), *still):
            if span.beams[-1] < len(hidden):  # they rise
                hidden[span.beams] = True
        return scan.with_ranges(np.where(hidden, np.nan, scan.ranges)) if hidden.any() else scan


def _spans(beams: BoolArray, since: FloatArray, until: float) -> list[_Span]:
    """Return the spans of blocked beams (B,), one for each reading at which beams became blocked."""
    return [_Span(float(begin), until, np.flatnonzero(beams & (since == begin))) for begin in np.unique(since[beams])]


def directions(scan: LaserScan, beams: BoolArray) -> str:
    """Return the directions of beams (B,) as text; beams a few degrees apart are one interval."""
    angles = np.degrees(scan.angle_min + scan.angle_increment * np.flatnonzero(beams))
    parts = np.split(angles, np.flatnonzero(np.abs(np.diff(angles)) > 5.0) + 1)
    listed = ", ".join(f"{part[0]:.0f} to {part[-1]:.0f}" for part in parts[:_MOST_TOLD])
    return f"{listed}°" + (f" and {len(parts) - _MOST_TOLD} more" if len(parts) > _MOST_TOLD else "")


class BlockedBeamsConfig(FrozenConfig):
    """When a beam counts as blocked by the robot itself."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="detect beams that a part of the robot blocks, and ignore them")
    spread: float = Field(0.02, gt=0, description="largest difference between the ranges of a blocked beam [m]")
    near: float = Field(1.0, gt=0, description="largest range of a blocked beam [m]")
    travelled: float = Field(2.0, gt=0, description="distance after which a constant range counts as blocked [m]")
    turned: float = Field(
        1.0,
        gt=0,
        description=(
            "rotation after which a constant range counts as blocked; the range to a wall along the path changes [rad]"
        ),
    )
    very_near: float = Field(
        0.35, gt=0, description="range below which shorter distances suffice, as few walls are so near for long [m]"
    )
    soon: float = Field(0.7, gt=0, description="distance for these short ranges [m]")
    soon_turned: float = Field(0.35, gt=0, description="rotation for these short ranges [rad]")
    fewest: int = Field(5, ge=1, description="least number of neighbouring beams that are blocked together")
    step: float = Field(0.3, gt=0, description="distance or rotation between two checks [m, rad]")


class BlockedBeams:
    """Detects blocked beams while the robot moves.

    `blocked` (B,) is the mask of the beams that are blocked now, and `any_blocked` whether any are.
    """

    def __init__(self, config: BlockedBeamsConfig) -> None:
        self._config = config
        soon = config.very_near, config.soon, config.soon_turned
        self._limits = (config.spread, config.near, config.travelled, config.turned, *soon)
        self._last: tuple[SE2, SE2 | None] | None = None
        self._spans = BlockedSpans()
        self._forget(0)

    def _forget(self, beams: int) -> None:
        """Restart with scans of this number of beams."""
        self.blocked: BoolArray = np.zeros(beams, dtype=np.bool_)
        self.any_blocked = False
        self._hidden = self.blocked  # with those suspected to be blocked
        self._hides = False
        self._state: FloatArray = np.zeros((6, beams))  # see `follow_beams`
        self._state[0] = np.nan
        self._distance = self._turn = 0.0

    @property
    def since(self) -> FloatArray:
        """Stamps (B,) since when the blocked beams are blocked [s]."""
        since: FloatArray = self._state[5]
        return since

    def learn(self, scan: LaserScan, index: int, T_map_robot: SE2, T_odom_robot: SE2 | None = None) -> bool:
        """Learn from the scan of a reading, and return whether further beams are blocked."""
        if len(scan.ranges) != len(self.blocked):
            self._spans.end(self.blocked, self._state[1], index)
            self._forget(len(scan.ranges))
            self._last = None
        here = T_map_robot, T_odom_robot
        (T_map_last, T_odom_last), is_first = self._last or here, self._last is None
        now, last = T_map_robot, T_map_last
        if T_odom_robot is not None and T_odom_last is not None:  # blocked beams seem to stand, and so does the scan
            now, last = T_odom_robot, T_odom_last
        distance = math.hypot(now.x - last.x, now.y - last.y)
        turn = math.remainder(now.theta - last.theta, 2.0 * math.pi)
        if not is_first and distance < self._config.step and abs(turn) < self._config.step:
            return False
        self._last = here
        return self._follow(scan, index, distance, turn)

    def forget_odometry(self) -> None:
        """Measure the motion to the next check by the map's poses, since the odometry jumped."""
        if self._last is not None:
            self._last = self._last[0], None

    def without(self, scan: LaserScan) -> LaserScan:
        """Return the scan without the ranges of blocked beams; a beam whose range has changed keeps it.

        A very short range that has not changed since the last check is removed too.
        """
        if not self._hides or len(scan.ranges) != len(self._hidden):
            return scan
        same = np.abs(scan.ranges - self._state[0]) <= self._config.spread
        return scan.with_ranges(np.where(self._hidden & same, np.nan, scan.ranges))

    def were_any(self) -> bool:
        """Return whether any beam was ever blocked."""
        return self._spans.were_any() or self.any_blocked

    def cleared(self, scan: LaserScan, index: int) -> LaserScan:
        """Return the scan of an earlier reading without the beams that were blocked then."""
        return self._spans.cleared(scan, index, self.blocked, self._state[1])

    def _follow(self, scan: LaserScan, index: int, distance: float, turn: float) -> bool:
        config, ranges = self._config, scan.ranges
        self._distance, self._turn = self._distance + distance, self._turn + turn
        if self.any_blocked:
            ends = np.isfinite(ranges) & ~(np.abs(ranges - self._state[0]) <= config.spread)
            self._spans.end(ends & self.blocked, self._state[1], index)
        here = float(index), self._distance, self._turn, distance, scan.stamp
        blocked, suspected, any_blocked, any_suspected = follow_beams(
            self._state, ranges, here, self._limits, config.fewest
        )
        more = any_blocked and bool((blocked & ~self.blocked).any())
        self._hides = any_blocked or any_suspected
        self._hidden = blocked | suspected if self._hides else blocked
        self.blocked, self.any_blocked = blocked, any_blocked
        return more


_LATELY_S = 60.0  # beams that were blocked within this time are not reported again
_TOGETHER_S = 5.0  # beams that become blocked within this time are reported together
_BESIDE = 0.07  # [rad]


class _Reported(NamedTuple):
    since: float
    beams: BoolArray
    number: int


class LaserView:
    """Removes blocked beams from the scans of one laser, and reports them."""

    def __init__(self, config: BlockedBeamsConfig, incidents: Incidents) -> None:
        self._incidents = incidents
        self._beams = BlockedBeams(config)
        self._reported: _Reported | None = None
        # Last times at which each beam was blocked, and at which a neighbour was blocked [s].
        self._known, self._beside = np.zeros(0), np.zeros(0)
        self._raw: LaserScan | None = None

    def cleaned(self, scan: LaserScan) -> LaserScan:
        """Return a scan without its blocked beams."""
        self._raw = scan
        return self._beams.without(scan)

    def forget_odometry(self) -> None:
        """Measure the motion to the next check by the map's poses, since the odometry jumped."""
        self._beams.forget_odometry()

    def learn(self, index: int, T_map_robot: SE2, T_odom_robot: SE2 | None = None) -> None:
        """Learn from the last scan, that of a reading, after the robot has moved."""
        scan = self._raw
        if scan is None:
            return
        if self._beams.learn(scan, index, T_map_robot, T_odom_robot):
            self._report(scan, self._beams)
        elif self._beams.any_blocked:
            self._note(scan, self._beams.blocked)

    def were_any_blocked(self) -> bool:
        """Return whether any beam was ever blocked."""
        return self._beams.were_any()

    def cleared(self, scan: LaserScan, index: int) -> LaserScan:
        """Return the scan of an earlier reading without the beams that were blocked then."""
        return self._beams.cleared(scan, index)

    def _report(self, scan: LaserScan, found: BlockedBeams) -> None:
        """Report beams that were not blocked lately, with the time since when they are blocked."""
        blocked = found.blocked
        if len(self._known) != len(blocked):
            self._reported = None
            self._known, self._beside = (np.full(len(blocked), -np.inf) for _ in range(2))
        # An obstruction is not reported twice, even after a gap in the recording.
        new = blocked & (scan.stamp - self._known > _LATELY_S) & (found.since > self._known)
        if new.any():
            since, reported = float(found.since[new].min()), self._reported
            if reported is not None and abs(since - reported.since) <= _TOGETHER_S:
                reported.beams[new] = True
                self._incidents.reword(reported.number, _blocks(scan, reported.beams))
            elif (new & (scan.stamp - self._beside > _LATELY_S)).any():  # neighbours at the edges change often
                self._reported = _Reported(since, new, self._incidents.add(since, _blocks(scan, new)))
        self._note(scan, blocked)

    def _note(self, scan: LaserScan, blocked: BoolArray) -> None:
        """Note that beams (B,) are blocked."""
        self._known[blocked] = scan.stamp
        self._beside[_widened(blocked, scan.angle_increment)] = scan.stamp


def _widened(blocked: BoolArray, angle_increment: float) -> BoolArray:
    """Return beams (B,) and their neighbours."""
    beams = len(blocked)
    # At most the number of beams, also for a narrow field of view; a single beam has no step.
    beside = math.ceil(_BESIDE / max(abs(angle_increment), _BESIDE / beams))
    widened: BoolArray = np.convolve(blocked, np.ones(2 * beside + 1))[beside : beside + beams] > 0.5
    return widened


def _blocks(scan: LaserScan, beams: BoolArray) -> str:
    return (
        f"a part of the robot, or something that moves with it, blocks {beams.mean():.0%} of the beams, "
        f"{directions(scan, beams)}"
    )
