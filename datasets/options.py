"""How a recording is to be read: every automatic choice can be overridden here."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from tbmslam.geometry.se2 import SE2

Profile = Literal["auto", "stata"]
OdometrySource = Literal["auto", "tf", "topic", "none"]
NoReturn = Literal["free", "drop"]
_FARTHEST_SENSOR = 1000.0
_LARGEST_OFFSET = 10.0


@dataclass(frozen=True)
class RecordingOptions:
    """Options of a recording; None means that the value is detected.

    Parameters
    ----------
    profile
        "stata" fixes topics and frames of the MIT Stata Center recordings; "auto" finds them.
    scan_topic
        Topic of the scans; needed where a bag holds several. In a CARMEN log: FLASER, ROBOTLASER1, RAWLASER1.
    laser_frame
        Frame of the laser whose scans are read if a topic has several lasers; None for the laser with most
        usable scans at the beginning.
    odometry
        "tf", "topic", "none", or "auto": tf where it connects the odometry frame with the robot, else the topic.
    odometry_topic
        Topic of nav_msgs/Odometry or geometry_msgs/PoseWithCovarianceStamped messages.
    tf_topics
        Topics that carry transforms; None: every topic of that type.
    odom_frame, robot_frame
        Frames between which odometry is read from tf.
    sensor_pose
        Pose of the laser on the robot, T_robot_sensor, instead of the recorded one.
    upside_down
        Whether the laser is mounted upside down, regardless of tf.
    angle_step_deg
        Angle between beams [deg] instead of the recorded one; the first beam keeps its direction.
    range_min, range_max
        Limits of the laser [m] instead of the recorded ones.
    cloud_heights
        Lowest and highest point of the slice of point clouds that becomes scans, above the robot's frame [m]; None: a
        quarter of a metre around the sensor, without the floor.
    range_offset
        Added to every range that was measured [m].
    no_return
        Meaning of a beam without a return: "free", nothing in range, or "drop", unknown.
    no_return_codes
        Further range values that mean no return [m].
    odometry_scale
        What the odometry's lengths are multiplied by: 0.001 where they are in millimetres.
    clock_offset
        Seconds to add to a scan's stamp before odometry is looked up; None: detected, 0 if the clocks agree.
    gap_s
        A pause between scans longer than this is counted as a gap [s].
    max_odometry_gap_s
        Odometry is not interpolated between poses further apart than this [s].
    """

    profile: Profile = "auto"
    scan_topic: str | None = None
    laser_frame: str | None = None
    odometry: OdometrySource = "auto"
    odometry_topic: str | None = None
    tf_topics: tuple[str, ...] | None = None
    odom_frame: str | None = None
    robot_frame: str | None = None
    sensor_pose: SE2 | None = None
    upside_down: bool | None = None
    angle_step_deg: float | None = None
    range_min: float | None = None
    range_max: float | None = None
    range_offset: float = 0.0
    no_return: NoReturn = "free"
    no_return_codes: tuple[float, ...] = ()
    odometry_scale: float = 1.0
    clock_offset: float | None = None
    cloud_heights: tuple[float, float] | None = None
    gap_s: float = 2.0
    max_odometry_gap_s: float = 5.0

    def __post_init__(self) -> None:
        """Refuse values that cannot be meant."""
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
        if self.angle_step_deg is not None and (self.angle_step_deg == 0.0 or not math.isfinite(self.angle_step_deg)):
            raise ValueError(f"angle_step_deg must be finite and not 0, got {self.angle_step_deg}")
        if self.clock_offset is not None and not math.isfinite(self.clock_offset):
            raise ValueError(f"clock_offset must be finite, got {self.clock_offset}")

    @staticmethod
    def _check_order(rule: str, low: float | None, high: float | None) -> None:
        if low is not None and high is not None and not low < high:
            raise ValueError(f"{rule}, got {low} and {high}")
