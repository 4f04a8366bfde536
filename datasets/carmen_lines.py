"""Lines of the logs of CARMEN and of CMU's robotics course."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from datasets.scans.intake import RawScan
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import FARTHEST_PLACE

SCAN_KINDS = ("FLASER", "ROBOTLASER1", "RAWLASER1", "L")
# These lines state no limit. A SICK LMS measures up to 80 m; longer ranges are codes.
SICK_RANGE_MAX = 80.0
_LATEST = 1e11  # some thousand years [s]


class LoggedScan(NamedTuple):
    """A scan, the odometry of its line (if any) and the mount of the laser."""

    raw: RawScan
    T_odom_robot: SE2 | None
    T_robot_sensor: SE2


class LogSettings(NamedTuple):
    """Settings of a whole log."""

    laser_offset: float = 0.0
    """Place of the laser before the robot's centre [m]."""
    range_max: float = SICK_RANGE_MAX
    """Limit of a laser whose lines state none [m]."""
    times: Literal["ipc", "logger", "none"] = "ipc"
    """Times to use: when messages were made, or when they were logged; "none" if neither is known."""
    odometry: Literal["second", "first"] = "second"
    """Pose of a FLASER to use."""


def kind_of(line: str) -> str:
    """Return the first word of a line, by which it is a scan, odometry, or something else."""
    words = line.split(None, 1)
    return words[0] if words else ""


def scan_from(line: str, settings: LogSettings) -> LoggedScan:
    """Read a line of one of `SCAN_KINDS`; ValueError or IndexError if it is cut off or of another kind."""
    words = line.split()
    return _SCAN_READERS[words[0]](words, settings)


def pose_from(line: str, settings: LogSettings) -> tuple[float, SE2]:
    """Read time [s] and T_odom_robot from a line of ODOM; ValueError or IndexError if it is cut off."""
    words = line.split()
    return _time(words[-3:], settings), _pose(words[1:4])


def _flaser(words: list[str], settings: LogSettings) -> LoggedScan:
    """Read a front laser; its first pose may have been corrected by a mapper, the second is raw odometry."""
    number = int(words[1])
    ranges, rest = words[2 : 2 + number], words[2 + number :]
    angle_min, step = _fan(number)
    raw = RawScan(_time(rest[6:], settings), angle_min, step, 0.0, settings.range_max, _ranges(ranges))
    poses = {"first": _pose(rest[0:3]), "second": _pose(rest[3:6])}
    return LoggedScan(raw, poses[settings.odometry], SE2(settings.laser_offset, 0.0, 0.0))


def _raw_laser(words: list[str], settings: LogSettings) -> LoggedScan:
    """Read a laser that states its own geometry."""
    raw, _ = _stated(words, settings)
    return LoggedScan(raw, None, SE2(settings.laser_offset, 0.0, 0.0))


def _robot_laser(words: list[str], settings: LogSettings) -> LoggedScan:
    """Read a laser that states its own geometry and both poses."""
    raw, rest = _stated(words, settings)
    laser, robot = _pose(rest[0:3]), _pose(rest[3:6])
    return LoggedScan(raw, robot, robot.inverse() @ laser)


def _stated(words: list[str], settings: LogSettings) -> tuple[RawScan, list[str]]:
    """Read the common part of RAWLASER1 and ROBOTLASER1; return it and the words behind the remissions."""
    start, _, step, range_max = map(float, words[2:6])
    number = int(words[8])
    end = 9 + number
    remissions = int(words[end])
    scan = RawScan(_time(words[-3:], settings), start, step, 0.0, range_max, _ranges(words[9:end]))
    return scan, words[end + 1 + remissions :]


def _cmu_laser(words: list[str], settings: LogSettings) -> LoggedScan:
    """Read a scan of CMU's course."""
    robot, laser = _in_metres(_pose(words[1:4])), _in_metres(_pose(words[4:7]))
    ranges = 0.01 * _ranges(words[7:-1])
    angle_min, step = _fan(len(ranges))
    raw = RawScan(_seconds(words[-1]), angle_min, step, 0.0, settings.range_max, ranges)
    return LoggedScan(raw, robot, robot.inverse() @ laser)


_SCAN_READERS: dict[str, Callable[[list[str], LogSettings], LoggedScan]] = {
    "FLASER": _flaser,
    "RAWLASER1": _raw_laser,
    "ROBOTLASER1": _robot_laser,
    "L": _cmu_laser,
}


def _pose(words: list[str]) -> SE2:
    """Read a pose; ValueError if it is impossible, since compiled code would compute a memory address from it."""
    x, y, theta = map(float, words)
    pose = SE2(x, y, theta)
    if not abs(pose.x) + abs(pose.y) + abs(pose.theta) <= FARTHEST_PLACE:
        raise ValueError(f"pose must be finite and on earth, got {pose}")
    return pose


def _in_metres(pose: SE2) -> SE2:
    """Return a pose that was stated in centimetres."""
    return SE2(0.01 * pose.x, 0.01 * pose.y, pose.theta)


def _seconds(word: str) -> float:
    """Read a time; ValueError if it is impossible."""
    seconds = float(word)
    if not abs(seconds) <= _LATEST:
        raise ValueError(f"time must be finite and of this age, got {word}")
    return seconds


def _fan(number: int) -> tuple[float, float]:
    """Return first direction and step [rad] of a SICK that states neither: usually half a turn from the right.

    180 or 181 beams have steps of 1 degree, 360 or 361 beams have steps of half a degree. 401 beams cover 100 degrees.
    """
    if number == 401:
        return math.radians(-50.0), math.radians(0.25)
    beams = number - number % 2
    return math.radians(-90.0), math.radians(180.0 / beams) if beams else 0.0


def _ranges(words: list[str]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([float(word) for word in words])


def _time(words: list[str], settings: LogSettings) -> float:
    """Return the time of a line from its last words: when its message was made, the computer, and when it was logged.

    Some programs wrote no times, or only the last one. The time is 0 if no times are used.
    """
    if settings.times == "none":
        return 0.0
    if len(words) < (3 if settings.times == "ipc" else 1):
        raise ValueError(f"a line must end in its {settings.times} time, got {len(words)} words behind the poses")
    return _seconds(words[-3] if settings.times == "ipc" else words[-1])
