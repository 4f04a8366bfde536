"""Choice of the topics of a bag."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

from datasets.counts import in_number
from datasets.errors import DatasetError
from datasets.options import RecordingOptions
from datasets.rosbag.files import BagFiles, Topic
from datasets.rosbag.messages import CLOUD_TYPE, ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, SCAN_TYPE, TF_TYPES
from datasets.rosbag.republished import republished
from tbmslam.geometry.se2 import SE2


def of_same_robot(names: Sequence[str], scan: str, other_scans: Sequence[str]) -> list[str]:
    """Return the topics in `names` that do not belong to another robot, in their order.

    Robots in one bag have namespaces: /robot_1/tf belongs to the chosen topic /robot_1/scan. A topic whose name is
    nearer to `other_scans` belongs to another robot. So does a topic beside other scans, if the robot has a topic of
    its own.
    """
    nearness = nearness_to(scan)
    others = [nearness_to(other) for other in other_scans]
    own = [name for name in names if all(near(name) <= nearness(name) for near in others)]
    nearest = max(map(nearness, own), default=0)
    homes = {_namespace(other) for other in other_scans} - {_namespace(scan)}
    return [name for name in own if nearness(name) == nearest or _namespace(name) not in homes]


def nearness_to(scan: str) -> Callable[[str], int]:
    """Return a function that counts the common names of a topic's namespace and that of the scans."""
    home = _namespace(scan)

    def shared(name: str) -> int:
        common = 0
        for part, other in zip(_namespace(name), home, strict=False):
            if part != other:
                break
            common += 1
        return common

    return shared


def is_plain_odom(name: str, scan: str) -> bool:
    """Return whether a topic is named odom, in the namespace of the scans or in a parent namespace."""
    return name.rsplit("/", 1)[-1] == "odom" and len(_namespace(name)) == nearness_to(scan)(name)


def _namespace(name: str) -> tuple[str, ...]:
    """Return the parts of a topic's name before the last."""
    return tuple(name.strip("/").split("/")[:-1])


_MOST_NAMES = 3
_SCAN_TYPES = (SCAN_TYPE, ECHOES_TYPE, CLOUD_TYPE)
_LIDAR_PACKAGES = ("velodyne", "pandar", "hesai", "nebula", "ouster", "livox", "rslidar", "robosense", "lslidar")
"""Prefixes of the packages whose messages hold packets of a lidar, or points in a form of its own."""


class ChosenTopics(NamedTuple):
    """Names of the topics that matter."""

    scan: str
    transforms: tuple[str, ...]
    odometry: str | None
    doubt: str | None = None
    """Warning about topics with the same scans."""

    def all(self) -> tuple[str, ...]:
        """Return the names of all chosen topics."""
        return (self.scan, *self.transforms, *([] if self.odometry is None else [self.odometry]))


def choose_topics(files: BagFiles, options: RecordingOptions) -> ChosenTopics:
    """Choose the topics of the scans, the transforms and the odometry."""
    scan, doubt = _scan_topic(files, options)
    transforms: tuple[str, ...] = ()
    if options.odometry != "none" or options.sensor_pose is None:
        transforms = _transforms(files, options, scan)
    odometry = _odometry_topic(files, options, scan) if options.odometry in ("auto", "topic") else None
    return ChosenTopics(scan, transforms, odometry, doubt)


def is_static(topic: str) -> bool:
    """Return whether the transforms of a topic are constant."""
    return topic.endswith("tf_static")


def _scan_topic(files: BagFiles, options: RecordingOptions) -> tuple[str, str | None]:
    """Return the topic of the scans, and a warning if others hold the same scans."""
    if options.scan_topic is not None:
        topic = _named(files, options.scan_topic, _SCAN_TYPES, "--scan-topic")
        if not topic.messages:
            raise DatasetError(f"{_names(files)}: {topic.name} holds no messages: choose another with --scan-topic")
        return topic.name, None
    # Scans with several echoes mostly exist as LaserScan, too. A level scan is better than the slice of a cloud.
    scans = files.of_type(SCAN_TYPE) or files.of_type(ECHOES_TYPE) or files.of_type(CLOUD_TYPE)
    filled = [topic for topic in scans if topic.messages]
    if len(filled) == 1:
        return filled[0].name, None
    if filled and (same := republished(files, filled)):
        return same.best, same.text()
    if filled:
        listed = ", ".join(f"{topic.name} ({in_number(topic.messages, 'scan', 'scans')})" for topic in filled)
        kind = scans[0].msgtype.rsplit("/", 1)[-1]
        raise DatasetError(f"{_names(files)}: several {kind} topics hold scans: {listed}: choose one with --scan-topic")
    if scans:
        listed = ", ".join(topic.name for topic in scans)
        others = _own_data(files) or ": give another recording"
        raise DatasetError(f"{_names(files)}: {listed} holds no messages{others}")
    listed = ", ".join(sorted(files.topics)) or "no topics at all"
    others = _own_data(files) or f"; there are {listed}: choose another recording"
    raise DatasetError(f"{_names(files)}: no topic is a LaserScan or PointCloud2{others}")


def _own_data(files: BagFiles) -> str:
    """Return which topics hold data that a lidar's driver or a converter must decode first; empty if none does."""
    topics = sorted(topic for topic in files.topics.values() if topic.messages)
    raw = [f"{topic.name} ({topic.msgtype})" for topic in topics if topic.msgtype.startswith(_LIDAR_PACKAGES)]
    remedy = "convert packets to PointCloud2 with the lidar's driver, CustomMsg with a converter"
    return f"; {', '.join(raw)} holds a lidar's own data: {remedy}" if raw else ""


def _transforms(files: BagFiles, options: RecordingOptions, scan: str) -> tuple[str, ...]:
    """Return the topics of transforms: the requested ones, or those of the robot."""
    if options.tf_topics is not None:
        return tuple(_named(files, name, TF_TYPES, "--tf-topic").name for name in options.tf_topics)
    filled = [topic.name for topic in files.of_type(*TF_TYPES) if topic.messages]
    static = [name for name in filled if is_static(name)]
    moving = [name for name in filled if not is_static(name)]
    own = [name for kind in (moving, static) for name in of_same_robot(kind, scan, _other_scans(files, scan))]
    return tuple(sorted(own))


def _other_scans(files: BagFiles, scan: str) -> list[str]:
    """Return the topics of scans that are not read."""
    return [topic.name for topic in files.of_type(*_SCAN_TYPES) if topic.messages and topic.name != scan]


def _odometry_topic(files: BagFiles, options: RecordingOptions, scan: str) -> str | None:
    """Return the topic that most likely holds the odometry of the robot with the scans; None if there is none."""
    if options.odometry_topic is not None:
        return _named(files, options.odometry_topic, (ODOMETRY_TYPE, POSE_TYPE), "--odometry-topic").name
    others, nearness = _other_scans(files, scan), nearness_to(scan)
    filled = of_same_robot([topic.name for topic in files.of_type(ODOMETRY_TYPE) if topic.messages], scan, others)
    # Other poses with covariance come from a localiser or from a click in a viewer.
    poses = [topic.name for topic in files.of_type(POSE_TYPE) if topic.messages and "odom" in topic.name]
    poses = of_same_robot(poses, scan, others)
    plain_first = sorted(filled, key=lambda name: (-nearness(name), not is_plain_odom(name, scan), name))
    if options.odometry == "topic" and not plain_first + poses:
        raise DatasetError(f"{_names(files)}: no topic holds odometry: choose another source with --odometry")
    if options.odometry == "topic" and len(filled) > 1 and not is_plain_odom(plain_first[0], scan):
        raise DatasetError(
            f"{_names(files)}: several topics hold odometry: {', '.join(filled)}: choose one with --odometry-topic"
        )
    return next(iter(plain_first + poses), None)


def _named(files: BagFiles, name: str, msgtypes: tuple[str, ...], option: str) -> Topic:
    """Return the requested topic, with or without its leading slash."""
    for topic in files.topics.values():
        if topic.name.strip("/") == name.strip("/"):
            if topic.msgtype not in msgtypes:
                raise DatasetError(
                    f"{_names(files)}: {topic.name} is a {topic.msgtype}, not a {' or '.join(msgtypes)}: "
                    f"choose another with {option}"
                )
            return topic
    fitting = ", ".join(topic.name for topic in files.of_type(*msgtypes)) or "no topic of a fitting type"
    raise DatasetError(f"{_names(files)}: there is no topic {name}; there is {fitting}: choose with {option}")


def _names(files: BagFiles) -> str:
    """Return the paths of the files as text; of many files the first ones."""
    more = len(files.paths) - _MOST_NAMES
    return ", ".join(map(str, files.paths[:_MOST_NAMES])) + (f" and {more} more" if more > 0 else "")


# Base laser of the PR2 in front of base_footprint; used if tf does not hold it.
STATA_SENSOR_POSE = SE2(0.275, 0.0, 0.0)
_STATA_SCANS = "base_scan"
_STATA_ODOMETRY = ("robot_pose_ekf/odom_combined", "base_odometry/odom")


def with_profile(options: RecordingOptions, topics: Collection[str]) -> RecordingOptions:
    """Return the options with the values of their profile; given options stay.

    Profile "stata" is for the MIT Stata Center (Fallon et al., IJRR 32(14), 2013). It takes the scans of the base laser
    and not those of the nodding /tilt_scan. The odometry is odom_combined -> base_footprint, and a localiser publishes
    map -> odom_combined.
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
