"""Beams blocked by something on the robot: they end at the same near distance wherever it drives and how it turns."""

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.rays.blocked_beams import follow_beams
from tbmslam.monitoring.blocked_spans import BlockedSpans
from tbmslam.sensing.laser_scan import LaserScan


class BlockedBeamsConfig(FrozenConfig):
    """When a beam counts as blocked by the robot itself."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="detect beams that a part of the robot blocks, and leave them out")
    spread: float = Field(0.02, gt=0, description="how far the ranges of such a beam differ, at the most [m]")
    near: float = Field(1.0, gt=0, description="they end within this [m]")
    travelled: float = Field(2.0, gt=0, description="after such a way and turn constant ranges are suspicious [m]")
    turned: float = Field(1.0, gt=0, description="turn that they must outlast: walls beside a way do not [rad]")
    very_near: float = Field(0.35, gt=0, description="few walls are as near as this for long [m]")
    soon: float = Field(0.7, gt=0, description="way for ranges as near as that [m]")
    soon_turned: float = Field(0.35, gt=0, description="turn for ranges as near as that [rad]")
    fewest: int = Field(5, ge=1, description="neighbouring beams that must be blocked together")
    step: float = Field(0.3, gt=0, description="way or turn between two looks [m, rad]")


class BlockedBeams:
    """Follows every beam while the robot moves.

    Parameters
    ----------
    config
        When a beam counts as blocked.

    Attributes
    ----------
    blocked
        Which beams (B,) are blocked now.
    """

    def __init__(self, config: BlockedBeamsConfig) -> None:
        self._config = config
        soon = config.very_near, config.soon, config.soon_turned
        self._limits = (config.spread, config.near, config.travelled, config.turned, *soon)
        self._last: SE2 | None = None
        self._spans = BlockedSpans()
        self._forget(0)

    def _forget(self, beams: int) -> None:
        """Begin with scans of so many beams."""
        self.blocked: npt.NDArray[np.bool_] = np.zeros(beams, dtype=np.bool_)
        self._hidden = self.blocked  # with those suspected to be blocked
        self._hides = False
        self._state: FloatArray = np.zeros((5, beams))  # see `follow_beams`
        self._state[0] = np.nan
        self._way = self._turn = 0.0

    @property
    def since(self) -> FloatArray:
        """Stamps (B,) since when beams that are blocked are so [s]."""
        since: FloatArray = self._state[1]
        return since

    def look(self, scan: LaserScan, T_odom_robot: SE2) -> bool:
        """Learn from a scan; return whether beams are blocked from now on that were not."""
        if len(scan.ranges) != len(self.blocked):
            self._spans.end(self.blocked, self.since, self._anywhere(), scan.stamp)
            self._forget(len(scan.ranges))
            self._last = None
        last = self._last or T_odom_robot
        way = math.hypot(T_odom_robot.x - last.x, T_odom_robot.y - last.y)
        turn = math.remainder(T_odom_robot.theta - last.theta, 2.0 * math.pi)
        if self._last is not None and way < self._config.step and abs(turn) < self._config.step:
            return False
        self._last = T_odom_robot
        return self._follow(scan, way, turn)

    def without(self, scan: LaserScan) -> LaserScan:
        """Return the scan without what blocked beams say; a beam that sees far again says what it sees.

        What is very near and did not change since the last look is not believed either, as long as it does not.
        """
        if not self._hides or len(scan.ranges) != len(self._hidden):
            return scan
        same = np.abs(scan.ranges - self._state[0]) <= self._config.spread
        return scan.with_ranges(np.where(self._hidden & same, np.nan, scan.ranges))

    def were_any(self) -> bool:
        """Tell whether any beam was blocked at any time."""
        return self._spans.were_any() or bool(self.blocked.any())

    def cleared(self, scan: LaserScan) -> LaserScan:
        """Return an earlier scan without the beams that were blocked, as is known afterwards."""
        return self._spans.cleared(scan, self.blocked, self.since, self._anywhere())

    def _follow(self, scan: LaserScan, way: float, turn: float) -> bool:
        config, ranges = self._config, scan.ranges
        self._way, self._turn = self._way + way, self._turn + turn
        if self.blocked.any():
            ends = np.isfinite(ranges) & ~(np.abs(ranges - self._state[0]) <= config.spread)
            self._spans.end(ends & self.blocked, self.since, self._anywhere(), scan.stamp)
        here = scan.stamp, self._way, self._turn, way
        blocked, suspected = follow_beams(self._state, ranges, here, self._limits, config.fewest)
        more = bool((blocked & ~self.blocked).any())
        self.blocked, self._hidden = blocked, blocked | suspected
        self._hides = bool(self._hidden.any())
        return more

    def _anywhere(self) -> FloatArray:
        """Return how far blocked beams (B,) ended at the most: whatever they said is left out [m]."""
        return np.full(len(self.blocked), np.inf)
