"""Parts of the robot in the laser's view, told without turning: their places in the world were seen through.

On a way straight ahead a wall beside it stays at one range, as what is on the robot does. But a wall stays where it is,
so that no scan from elsewhere goes through it; where a part of the robot was, or will be, all is empty.
"""

import math

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.kernels import BoolArray
from tbmslam.kernels.parts_in_view import count_refuted, follow_ranges, refuted_runs, smoothed_ranges
from tbmslam.laser_scan import LaserScan
from tbmslam.monitoring.blocked_spans import BlockedSpans
from tbmslam.monitoring.glass_walls import is_square_to_way, turns_along
from tbmslam.se2 import SE2, FloatArray, way_lengths


class PartsInViewConfig(FrozenConfig):
    """When beams end on what goes along with the robot."""

    enabled: bool = Field(True, description="look for them")
    spread: float = Field(0.04, gt=0, description="how far a range of such a beam is from their mean, at the most [m]")
    near: float = Field(3.0, gt=0, description="they end within this [m]")
    travelled: float = Field(1.0, gt=0, description="way for which they do [m]")
    square: float = Field(
        5.0, gt=0, description="the same where they are square to it, and may see a wall of glass [m]"
    )
    refuted: int = Field(3, ge=1, description="ends of each that turned out to be no places")
    fewest: int = Field(3, ge=1, description="neighbouring beams of which all that is true")
    depth: float = Field(0.1, gt=0, description="how far beams went on that saw through a place [m]")
    beside: float = Field(0.05, gt=0, description="how far around it all of them did [m]")
    unsure: float = Field(0.035, ge=0, description="and how much farther, as no pose is exact [rad]")
    edge: float = Field(0.035, ge=0, description="beams so near to them see the same now and then [rad]")
    step: float = Field(0.25, gt=0, description="way or turn between two looks [m, rad]")
    looks: int = Field(10, ge=2, description="looks that are remembered")
    disagreement: float = Field(
        0.15, gt=0, description="odometry and scans apart by more than this forget them [m, rad]"
    )


class PartsInView:
    """Follows every beam while the robot drives.

    Parameters
    ----------
    config
        When a beam counts as blocked.

    Attributes
    ----------
    blocked
        Which beams (B,) are blocked now.
    since
        Since when they are (B,) [s].
    """

    def __init__(self, config: PartsInViewConfig) -> None:
        self._config = config
        self.blocked: BoolArray
        self.since: FloatArray
        self._astray: BoolArray
        self._spans = BlockedSpans()
        self._T_map_last = SE2.identity()
        self._count, self._way = 0, 0.0  # looks that are remembered, and the way by the last one
        self._begin(0)

    def forget(self, before: float = math.inf) -> None:
        """Forget where scans were taken before a stamp [s]; what was constant is so all the same.

        By default all of them, as where the robot got lost. The way on which beams were constant counts from the first
        one that is left, and what refuted its ends may have been another one, so that these are asked anew.
        """
        early = np.flatnonzero(self._stamps[: self._count] < before)
        gone = int(early[-1]) + 1 if len(early) else 0
        for kept in (self._lasers, self._stamps, self._seen):
            kept[: self._count - gone] = kept[gone : self._count].copy()
        self._count -= gone
        self._refuted[:] = False
        if not self._count:
            self._T_odom_last: SE2 | None = None
        way = float(way_lengths(self._lasers[: self._count])[-1]) if self._count else 0.0
        self._state[2] = np.maximum(self._state[2] - (self._way - way), 0.0)
        self._state[4], self._way = 0.0, way

    def look(self, scan: LaserScan, T_map_sensor: SE2, T_odom_sensor: SE2 | None) -> None:
        """Learn from a scan and where it was taken."""
        if len(scan.ranges) != len(self.blocked):
            self._spans.end(self._hidden, self.since, self._farthest, scan.stamp)
            self._begin(len(scan.ranges))
        if self._count:
            moved = self._T_map_last.to(T_map_sensor)
            way = math.hypot(moved.x, moved.y)
            if max(way, abs(moved.theta)) < self._config.step:
                return
            if self._disagrees(moved, T_odom_sensor):
                self.forget()
            self._way += way
        self._T_map_last, self._T_odom_last = T_map_sensor, T_odom_sensor
        ranges = smoothed_ranges(scan.ranges)
        self._remember(scan.stamp, T_map_sensor, ranges)
        found = self._found(scan, ranges)
        # A part may shake; what is not where it was at two looks is gone.
        astray = self.blocked
        if self._hides:
            astray = self.blocked & (np.abs(ranges - self._reference) > 2.0 * self._config.spread)
        gone, self._astray = astray & self._astray, astray
        if gone.any() or (found & ~self.blocked).any():
            self._change(found, gone, scan)

    def without(self, scan: LaserScan) -> LaserScan:
        """Return the scan without what blocked beams say; a beam that sees farther says what it sees."""
        if not self._hides or len(scan.ranges) != len(self.blocked):
            return scan
        hidden = self._hidden & (scan.ranges <= self._farthest)
        return scan.with_ranges(np.where(hidden, np.nan, scan.ranges)) if hidden.any() else scan

    def were_any(self) -> bool:
        """Tell whether any beam was blocked at any time."""
        return self._hides or self._spans.were_any()

    def cleared(self, scan: LaserScan) -> LaserScan:
        """Return an earlier scan without what blocked beams said, as is known afterwards."""
        return self._spans.cleared(scan, self._hidden, self.since, self._farthest)

    def _begin(self, beams: int) -> None:
        """Begin with scans of so many beams."""
        self.blocked, self._hides = np.zeros(beams, dtype=np.bool_), False
        self._hidden: BoolArray = self.blocked  # with those at the edges, which see a part now and then
        self._astray = self.blocked
        self.since = np.zeros(beams)
        self._reference: FloatArray = np.zeros(beams)
        self._farthest: FloatArray = np.zeros(beams)
        self._state: FloatArray = np.full((5, beams), np.nan)  # see `follow_ranges`
        # Of each look where and when it was, what it saw, and which ends turned out to be no places; the last one last.
        looks = self._config.looks
        self._lasers, self._stamps, self._seen = np.zeros((looks, 3)), np.zeros(looks), np.zeros((looks, beams))
        self._refuted: BoolArray = np.zeros((looks, beams), dtype=np.bool_)
        self._count = 0
        self.forget()

    def _remember(self, stamp: float, T_map_sensor: SE2, ranges: FloatArray) -> None:
        """Remember a look, and forget the oldest where there are as many as may be."""
        if self._count == self._config.looks:
            for kept in (self._lasers, self._stamps, self._seen, self._refuted):
                kept[:-1] = kept[1:]
        else:
            self._count += 1
        last = self._count - 1
        self._lasers[last], self._stamps[last], self._seen[last] = T_map_sensor, stamp, ranges
        self._refuted[last] = False

    def _disagrees(self, moved: SE2, T_odom_sensor: SE2 | None) -> bool:
        """Tell whether the odometry says otherwise about the motion since the last look: one of both is wrong."""
        if self._T_odom_last is None or T_odom_sensor is None:
            return False
        apart = moved.to(self._T_odom_last.to(T_odom_sensor))
        return max(math.hypot(apart.x, apart.y), abs(math.remainder(apart.theta, math.tau))) > self._config.disagreement

    def _found(self, scan: LaserScan, ranges: FloatArray) -> BoolArray:
        """Return which beams (B,) end on no place of the world, as is known by now."""
        config, state = self._config, self._state
        follow_ranges(state, ranges, (scan.stamp, self._way), (config.spread, config.near))
        lasers, stamps, seen = self._lasers[: self._count], self._stamps[: self._count], self._seen[: self._count]
        lately = self._way - 0.5 * config.travelled
        limits = lately, config.depth, config.beside, config.unsure
        beams = scan.angle_min, scan.angle_increment
        count_refuted(state, self._refuted[: self._count], beams, lasers, stamps, seen, limits)
        found = refuted_runs(state, self._way, (config.travelled, config.refuted, config.fewest))
        for begin, end in _runs(found & ~self.blocked) if found.any() else ():
            if self._may_be_glass(begin, end, scan, lasers, seen):
                found[begin:end] = False
        return found

    def _may_be_glass(self, begin: int, end: int, scan: LaserScan, lasers: FloatArray, seen: FloatArray) -> bool:
        """Tell whether beams may see a wall of glass beside the way; one that turns as no part does begins anew."""
        config, state = self._config, self._state
        bearings: FloatArray = scan.angle_min + scan.angle_increment * np.arange(begin, end, dtype=np.float64)
        if self.blocked[max(begin - 1, 0) : end + 1].any() or not is_square_to_way(bearings, lasers):
            return False
        farthest = float(state[0, begin:end].max()) + 2.0 * config.spread
        turns = turns_along(begin, end, lasers, seen, farthest, scan.angle_increment)
        if turns < 0:
            state[2, begin:end] = self._way
        return turns < 0 or (turns == 0 and self._way - float(state[2, begin:end].min()) < config.square)

    def _change(self, found: BoolArray, gone: BoolArray, scan: LaserScan) -> None:
        """Block what was found and free what is gone."""
        since, farthest, hidden = self.since.copy(), self._farthest, self._hidden
        new = found & ~self.blocked
        self.blocked = self.blocked & ~gone | new
        self._reference[new], self.since[new] = self._state[0, new], self._state[1, new]
        for begin, end in _runs(self.blocked):  # a part comes as a whole
            self.since[begin:end] = self.since[begin:end].min()
        self._hide(max(round(self._config.edge / abs(scan.angle_increment)), 1))
        self._spans.end(hidden & ~self._hidden, since, farthest, scan.stamp)

    def _hide(self, edge: int) -> None:
        """Hide what is blocked, and so many beams beside it."""
        self._hidden, self._hides = self.blocked, bool(self.blocked.any())
        if not self._hides:
            return
        core, every = np.flatnonzero(self.blocked), np.arange(len(self.blocked))
        after = np.searchsorted(core, every).clip(0, len(core) - 1)
        before = np.maximum(after - 1, 0)
        nearest = core[np.where(np.abs(core[after] - every) <= np.abs(core[before] - every), after, before)]
        self._hidden = np.abs(nearest - every) <= edge
        self._farthest = self._reference[nearest] + 2.0 * self._config.spread
        self.since = self.since[nearest]


def _runs(marked: BoolArray) -> list[tuple[int, int]]:
    """Return where runs of marks (B,) begin and end."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
