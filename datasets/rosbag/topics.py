"""Which topics of a bag are read."""

from typing import NamedTuple

from datasets.errors import DatasetError
from datasets.options import RecordingOptions
from datasets.rosbag.files import BagFiles, Topic
from datasets.rosbag.message_types import CLOUD_TYPE, ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, SCAN_TYPE, TF_TYPES
from datasets.rosbag.same_robot import is_plain_odom, nearness_to, of_same_robot

_SCAN_TYPES = (SCAN_TYPE, ECHOES_TYPE, CLOUD_TYPE)


class ChosenTopics(NamedTuple):
    """Names of the topics that matter."""

    scan: str
    transforms: tuple[str, ...]
    odometry: tuple[str, ...]

    def all(self) -> tuple[str, ...]:
        """Return all of them."""
        return (self.scan, *self.transforms, *self.odometry)


def choose_topics(files: BagFiles, options: RecordingOptions) -> ChosenTopics:
    """Choose the scans, the transforms and the candidates for odometry.

    Raises
    ------
    DatasetError
        The scans are missing or there are several, or a topic that was asked for is not there.
    """
    scan = _scan_topic(files, options)
    transforms: tuple[str, ...] = ()
    if options.odometry != "none" or options.sensor_pose is None:
        transforms = _transforms(files, options, scan)
    odometry: tuple[str, ...] = ()
    if options.odometry in ("auto", "topic"):
        odometry = _odometry_topics(files, options, scan)
    return ChosenTopics(scan, transforms, odometry)


def is_static(topic: str) -> bool:
    """Return whether the transforms of a topic hold for good."""
    return topic.endswith("tf_static")


def _scan_topic(files: BagFiles, options: RecordingOptions) -> str:
    """Return the one topic of scans."""
    if options.scan_topic is not None:
        topic = _named(files, options.scan_topic, _SCAN_TYPES, "--scan-topic")
        if not topic.messages:
            raise DatasetError(f"{_names(files)}: {topic.name} holds no messages: choose another with --scan-topic")
        return topic.name
    # What has several echoes is mostly there as LaserScan, too. A level scan says more than the slice of a cloud.
    scans = files.of_type(SCAN_TYPE) or files.of_type(ECHOES_TYPE) or files.of_type(CLOUD_TYPE)
    filled = [topic for topic in scans if topic.messages]
    if len(filled) == 1:
        return filled[0].name
    if filled:
        listed = ", ".join(f"{topic.name} ({topic.messages} scans)" for topic in filled)
        kind = scans[0].msgtype.rsplit("/", 1)[-1]
        raise DatasetError(f"{_names(files)} has several {kind} topics: {listed}: choose one with --scan-topic")
    if scans:
        listed = ", ".join(topic.name for topic in scans)
        raise DatasetError(f"{_names(files)}: {listed} holds no messages: there is nothing to map")
    listed = ", ".join(sorted(files.topics)) or "no topics at all"
    raise DatasetError(
        f"{_names(files)} has no topic of LaserScan or PointCloud2; it has {listed}: choose another recording"
    )


def _transforms(files: BagFiles, options: RecordingOptions, scan: str) -> tuple[str, ...]:
    """Return the topics of transforms: those asked for, or the robot's."""
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


def _odometry_topics(files: BagFiles, options: RecordingOptions, scan: str) -> tuple[str, ...]:
    """Return the topics that may hold odometry, best first: the scans' own robot's before others."""
    if options.odometry_topic is not None:
        return (_named(files, options.odometry_topic, (ODOMETRY_TYPE, POSE_TYPE), "--odometry-topic").name,)
    others, nearness = _other_scans(files, scan), nearness_to(scan)
    filled = of_same_robot([topic.name for topic in files.of_type(ODOMETRY_TYPE) if topic.messages], scan, others)
    # Other poses with covariance are a localiser's, or a click of somebody's mouse.
    poses = [topic.name for topic in files.of_type(POSE_TYPE) if topic.messages and "odom" in topic.name]
    poses = of_same_robot(poses, scan, others)
    plain_first = sorted(filled, key=lambda name: (-nearness(name), not is_plain_odom(name, scan), name))
    if options.odometry == "topic" and not plain_first + poses:
        raise DatasetError(f"{_names(files)} has no odometry topic: choose another source with --odometry")
    if options.odometry == "topic" and len(filled) > 1 and not is_plain_odom(plain_first[0], scan):
        raise DatasetError(
            f"{_names(files)} has several Odometry topics: {', '.join(filled)}: choose one with --odometry-topic"
        )
    return tuple([*plain_first, *poses][:1])


def _named(files: BagFiles, name: str, msgtypes: tuple[str, ...], option: str) -> Topic:
    """Return the topic that was asked for, whether or not a leading slash was given."""
    for topic in files.topics.values():
        if topic.name.strip("/") == name.strip("/"):
            if topic.msgtype not in msgtypes:
                raise DatasetError(
                    f"{_names(files)}: {topic.name} is a {topic.msgtype}, not a {' or '.join(msgtypes)}: "
                    f"choose another with {option}"
                )
            return topic
    fitting = ", ".join(topic.name for topic in files.of_type(*msgtypes)) or "none of its type"
    raise DatasetError(f"{_names(files)} has no topic {name}; it has {fitting}: choose with {option}")


def _names(files: BagFiles) -> str:
    """Return the files' paths as one text."""
    return ", ".join(str(path) for path in files.paths)
