"""What of a laser's view the robot itself takes: beams left out of every scan, and told with the time."""

import math
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels import BoolArray
from tbmslam.monitoring.blocked_beams import BlockedBeams, BlockedBeamsConfig
from tbmslam.monitoring.blocked_spans import directions
from tbmslam.monitoring.incidents import Incidents
from tbmslam.sensing.laser_scan import LaserScan

_LATELY_S = 60.0  # beams that were blocked so lately are no news
_TOGETHER_S = 5.0  # what came so soon after other things is told with them
_BESIDE = 0.07  # [rad]


class _Told(NamedTuple):
    since: float
    beams: BoolArray
    number: int


class LaserView:
    """Watches over what one laser sees.

    Parameters
    ----------
    config
        When a beam counts as blocked.
    incidents
        Where it is told.
    """

    def __init__(self, config: BlockedBeamsConfig, incidents: Incidents) -> None:
        self._incidents = incidents
        self._beams = BlockedBeams(config)
        self._told: _Told | None = None
        # When each beam was last known to be blocked, and when one beside it was [s].
        self._known, self._beside = np.zeros(0), np.zeros(0)
        self._raw: LaserScan | None = None

    def cleaned(self, scan: LaserScan) -> LaserScan:
        """Return a scan without beams that are known to be blocked."""
        self._raw = scan
        return self._beams.without(scan)

    def look(self, T_odom_robot: SE2) -> None:
        """Learn from the last scan, now that the robot has moved."""
        scan = self._raw
        if scan is None:
            return
        if self._beams.look(scan, T_odom_robot):
            self._tell(scan, self._beams)
        else:
            self._note(scan, self._beams.blocked)

    def were_any_blocked(self) -> bool:
        """Tell whether any beam was blocked at any time."""
        return self._beams.were_any()

    def cleared(self, scan: LaserScan) -> LaserScan:
        """Return an earlier scan without the beams that were blocked, as is known afterwards."""
        return self._beams.cleared(scan)

    def _tell(self, scan: LaserScan, found: BlockedBeams) -> None:
        """Tell which beams are blocked that were not lately, with the time since when they are."""
        blocked = found.blocked
        if len(self._known) != len(blocked):
            self._told = None
            self._known, self._beside = (np.full(len(blocked), -np.inf) for _ in range(2))
        # What has been there since before it was last known is no news, even after a gap in the recording.
        new = blocked & (scan.stamp - self._known > _LATELY_S) & (found.since > self._known)
        if new.any():
            since, told = float(found.since[new].min()), self._told
            if told is not None and abs(since - told.since) <= _TOGETHER_S:
                told.beams[new] = True
                self._incidents.reword(told.number, _blocks(scan, told.beams))
            elif (new & (scan.stamp - self._beside > _LATELY_S)).any():  # at the edges others come and go
                self._told = _Told(since, new, self._incidents.add(since, _blocks(scan, new)))
        self._note(scan, blocked)

    def _note(self, scan: LaserScan, blocked: BoolArray) -> None:
        """Note that beams (B,) are known to be blocked."""
        if blocked.any():
            self._known[blocked] = scan.stamp
            self._beside[_widened(blocked, scan.angle_increment)] = scan.stamp


def _widened(blocked: BoolArray, angle_increment: float) -> BoolArray:
    """Return beams (B,) and those beside them."""
    beams = len(blocked)
    # No more than there are, however narrow the fan; a single beam has no step.
    beside = math.ceil(_BESIDE / max(abs(angle_increment), _BESIDE / beams))
    widened: BoolArray = np.convolve(blocked, np.ones(2 * beside + 1))[beside : beside + beams] > 0.5
    return widened


def _blocks(scan: LaserScan, beams: BoolArray) -> str:
    return (
        f"something on the robot, or along with it, blocks {beams.mean():.0%} of the beams, {directions(scan, beams)}"
    )
