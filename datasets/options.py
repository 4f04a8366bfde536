"""Options of reading a recording, which replace automatic choices."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from tbmslam.geometry.se2 import SE2

Profile = Literal["auto", "stata"]
OdometrySource = Literal["auto", "tf", "topic", "none"]
NoReturn = Literal["free", "drop"]
_FARTHEST_SENSOR = 1000.0
_LARGEST_OFFSET = 10.0
_SMALLEST_STEP, _LARGEST_STEP = 1e-3, 90.0  # [degrees]


@dataclass(frozen=True)
class RecordingOptions:
    """Options of a recording; None means that the value is detected."""

    profile: Annotated[Profile, '"stata" fixes the topics and frames of the MIT Stata Center; "auto" finds them'] = (
        "auto"
    )
    scan_topic: Annotated[
        str | None, "topic of the scans, if a bag has several; in a CARMEN log FLASER, ROBOTLASER1, RAWLASER1 or L"
    ] = None
    laser_frame: Annotated[
        str | None,
        "frame of the laser, if a topic has several; without it the laser with most usable scans at the beginning",
    ] = None
    odometry: Annotated[
        OdometrySource,
        '"tf", "topic", "none", or "auto": tf if it connects the odometry frame with the robot, else the topic',
    ] = "auto"
    odometry_topic: Annotated[
        str | None, "topic of nav_msgs/Odometry or geometry_msgs/PoseWithCovarianceStamped messages"
    ] = None
    tf_topics: Annotated[tuple[str, ...] | None, "topics of transforms; without them every topic of that type"] = None
    odom_frame: Annotated[str | None, "frame of the odometry in tf"] = None
    robot_frame: Annotated[str | None, "frame of the robot in tf"] = None
    sensor_pose: Annotated[
        SE2 | None, "pose of the laser on the robot [m, m, rad] instead of the recorded one; its height and tilt stay"
    ] = None
    upside_down: Annotated[bool | None, "whether the laser is mounted upside down, regardless of tf"] = None
    angle_step_deg: Annotated[
        float | None, "angle between beams [deg] instead of the recorded one; the first beam keeps its direction"
    ] = None
    range_min: Annotated[float | None, "shortest valid range [m] instead of the recorded one"] = None
    range_max: Annotated[float | None, "least range that means no return [m] instead of the recorded one"] = None
    range_offset: Annotated[float, "offset that is added to every measured range [m]"] = 0.0
    no_return: Annotated[
        NoReturn, 'meaning of a beam without a return: "free", nothing in range, or "drop", unknown'
    ] = "free"
    no_return_codes: Annotated[tuple[float, ...], "further range values that mean no return [m]"] = ()
    odometry_scale: Annotated[float, "factor for the lengths of the odometry: 0.001 for millimetres"] = 1.0
    clock_offset: Annotated[
        float | None,
        "offset that is added to the stamp of a scan before odometry is looked up [s]; without it detected",
    ] = None
    cloud_heights: Annotated[
        tuple[float, float] | None,
        "heights above the robot's frame between which point clouds become scans [m]; without them 0.25 m around the "
        "sensor, without the floor",
    ] = None
    gap_s: Annotated[float, "a longer pause between scans is counted as a gap [s]"] = 2.0
    max_odometry_gap_s: Annotated[float, "odometry is not interpolated over longer gaps [s]"] = 5.0

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        for name, choice in (("profile", Profile), ("odometry", OdometrySource), ("no_return", NoReturn)):
            allowed = get_args(choice)
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {', '.join(allowed)}, got {getattr(self, name)!r}")
        topics = (self.scan_topic, self.odometry_topic, *(self.tf_topics or ()))
        names = (*topics, self.laser_frame, self.odom_frame, self.robot_frame)
        if "" in names:
            raise ValueError("names of topics and frames must not be empty: is a variable of the shell unset?")
        for name in ("range_max", "gap_s", "max_odometry_gap_s"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"{name} must be positive, got {value}")
        if self.range_min is not None and not self.range_min >= 0.0:
            raise ValueError(f"range_min must not be negative, got {self.range_min}")
        self._check_order("range_min must be below range_max", self.range_min, self.range_max)
        self._check_order("the first of cloud_heights must be below the second", *(self.cloud_heights or (None, None)))
        if not abs(self.range_offset) <= _LARGEST_OFFSET:
            raise ValueError(f"range_offset must be within {_LARGEST_OFFSET:g} m, got {self.range_offset}")
        if not 1e-6 <= self.odometry_scale <= 1e6:
            raise ValueError(f"odometry_scale must be between 1e-6 and 1e6, got {self.odometry_scale}")
        if self.sensor_pose is not None and not sum(map(abs, self.sensor_pose)) <= _FARTHEST_SENSOR:
            raise ValueError(
                f"sensor_pose must be finite and within {_FARTHEST_SENSOR:.0f} m, got {tuple(self.sensor_pose)}"
            )
        if self.angle_step_deg is not None and not _SMALLEST_STEP <= abs(self.angle_step_deg) <= _LARGEST_STEP:
            raise ValueError(
                f"angle_step_deg must be between {_SMALLEST_STEP:g} and {_LARGEST_STEP:g} degrees in either direction, "
                f"got {self.angle_step_deg}"
            )
        if self.clock_offset is not None and not math.isfinite(self.clock_offset):
            raise ValueError(f"clock_offset must be finite, got {self.clock_offset}")

    @staticmethod
    def _check_order(rule: str, low: float | None, high: float | None) -> None:
        if low is not None and high is not None and not low < high:
            raise ValueError(f"{rule}, got {low} and {high}")
