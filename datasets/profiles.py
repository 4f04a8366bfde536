"""Recordings whose names and places are known beforehand."""

from collections.abc import Collection
from dataclasses import replace

from datasets.options import RecordingOptions
from tbmslam.geometry.se2 import SE2

# Base laser of the PR2 in front of base_footprint; used where a Stata recording's tf does not tell.
STATA_SENSOR_POSE = SE2(0.275, 0.0, 0.0)
_STATA_SCANS = "base_scan"
_STATA_ODOMETRY = ("robot_pose_ekf/odom_combined", "base_odometry/odom")


def with_profile(options: RecordingOptions, topics: Collection[str]) -> RecordingOptions:
    """Fill in what the profile knows; what was asked for explicitly stays.

    Profile "stata", MIT Stata Center (Fallon et al., IJRR 32(14), 2013): the scans of the base laser, never those of
    the nodding /tilt_scan; odometry odom_combined -> base_footprint; map -> odom_combined is a localiser's.

    Parameters
    ----------
    options
        What was asked for.
    topics
        Names of the recording's topics.
    """
    if options.profile != "stata":
        return options
    return replace(
        options,
        scan_topic=options.scan_topic or _ending_in(topics, _STATA_SCANS) or f"/{_STATA_SCANS}",
        odometry_topic=options.odometry_topic
        or next((topic for name in _STATA_ODOMETRY if (topic := _ending_in(topics, name))), None),
        odom_frame=options.odom_frame or "odom_combined",
        robot_frame=options.robot_frame or "base_footprint",
    )


def _ending_in(topics: Collection[str], name: str) -> str | None:
    """Return the topic of this name, with or without slash and namespace."""
    return next((topic for topic in sorted(topics, key=len) if f"/{topic}".endswith(f"/{name}")), None)
