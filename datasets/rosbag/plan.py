"""The plan for reading a bag: topics, odometry, frames and clocks."""

import logging
import math
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from datasets.clouds import CloudSlice, choose_slice, is_optical, mounting, times_warning
from datasets.counts import in_number
from datasets.errors import DatasetError
from datasets.odometry.frames import Frames, Step, find_robot_frame, plain
from datasets.odometry.se3 import SE3
from datasets.odometry.source import Mounting, pose_along
from datasets.options import RecordingOptions
from datasets.rosbag.files import BagFiles, Message
from datasets.rosbag.messages import CLOUD_TYPE, SCAN_TYPE, TF_TYPES, FramedScan
from datasets.rosbag.survey import Survey, SurveyedLaser
from datasets.rosbag.topics import STATA_SENSOR_POSE, ChosenTopics, choose_topics, is_static, with_profile
from datasets.rosbag.velocities import holds_only_velocities
from datasets.scans.cleaning import limits_warning
from datasets.scans.clocks import LATENCY_LIMIT_S, ClockFinding, compare_clocks, lags_of_unset
from datasets.scans.intake import angle_warning
from tbmslam.geometry.se2 import SE2

logger = logging.getLogger(__name__)

_MOST_STATIC = 2000
_CLOUDS_TO_CHOOSE_BY = 20
_SCANS_FOR_DELAY = 50
_NEVER_ALL_BEYOND = 100.0  # a robot on a floor always sees something nearer [m]
_UNSTAMPED = "the {}scans have no stamps (all are zero), so the times of their recording are used"
_FIRST_UNSTAMPED = (
    "the first {} no stamps (zero): the times of their recording are used, by the clock of the later stamps"
)
_FAR_LASER, _TOO_FAR = 20.0, 1000.0  # larger than any robot, and than anything that moves [m]


@dataclass(frozen=True)
class Plan:
    """The choices for one bag."""

    files: BagFiles
    options: RecordingOptions
    topics: ChosenTopics
    laser: SurveyedLaser
    source: str
    """"tf", "topic" or "none"."""
    frames: Frames | None
    """Frames of the odometry in tf, if that is the source."""
    robot_frame: str | None
    to_sensor: list[Step] | None
    """Path from the robot's frame to the laser; None if tf does not hold it."""
    sensor_pose: SE2 | None
    """T_robot_sensor to use instead of the path."""
    clock: ClockFinding
    """Comparison of the clocks of scans and odometry."""
    unset_lags: tuple[float, float] = (0.0, 0.0)
    """Bag time minus the assumed stamp of scans and of odometry with unset stamps [s]."""
    doubts: tuple[str, ...] = ()
    """Warnings about topics with the same scans, contradictions in tf, the limits of the laser, and long pauses."""
    cut: CloudSlice | None = None
    """Slice that turns point clouds into scans, if the topic of scans holds clouds."""

    def topics_to_read(self) -> tuple[str, ...]:
        """Return the topics a pass needs."""
        moving_laser = any(not step.edge.is_fixed for step in self.to_sensor or []) and self.sensor_pose is None
        transforms = self.topics.transforms if self.source == "tf" or moving_laser else ()
        moving = [name for name in transforms if not is_static(name)]
        if self.source == "topic" and self.topics.odometry is not None:
            moving.append(self.topics.odometry)
        return (self.topics.scan, *moving)


def plan_reading(files: BagFiles, options: RecordingOptions) -> Plan:
    """Read the beginning of a bag and plan how to read all of it."""
    if options.odometry == "auto" and options.odometry_topic is not None:
        options = replace(options, odometry="topic")
    options = with_profile(options, files.topics)
    topics = choose_topics(files, options)
    files.check_for_robots(topics.scan)
    cut, times = None, None
    if files.topics[topics.scan].msgtype == CLOUD_TYPE:
        cut, options, times = _sliced(files, topics, options)
        files.slice_clouds(cut)
    survey = _surveyed(files, topics, options)
    laser = _laser(files, options, topics, survey)
    frames = _frames(files, options, topics, survey, laser)
    if (near := laser.nearest_usual()) > _NEVER_ALL_BEYOND:
        raise DatasetError(
            f"{files.paths[0]}: nine of ten ranges of {topics.scan} are beyond {near:.0f} m, perhaps in millimetres: "
            f"record them in metres, or choose another --scan-topic"
        )
    if laser.alternates():
        raise DatasetError(
            f"{files.paths[0]}: two lasers or robots share {topics.scan}, their scans alternate: record each on its "
            f"own topic"
        )
    source = _source(files, options, topics, frames, survey)
    frames = frames if source == "tf" else None
    robot_frame, to_sensor = _robot(survey, laser, options, frames)
    sensor_pose = options.sensor_pose
    if to_sensor is None and sensor_pose is None:
        sensor_pose = STATA_SENSOR_POSE if options.profile == "stata" else None
        logger.warning(
            "%s: tf does not hold the mount of the laser (frame %r); the default is %s: pass --sensor-pose%s",
            files.paths[0],
            laser.frame,
            "that of the PR2" if sensor_pose else "the robot's centre",
            ", and --upside-down if it hangs upside down" if options.upside_down is None else "",
        )
    odometry_lags = _odometry_lags(survey, frames, source)
    clock = compare_clocks(laser.lags, odometry_lags, laser.sweep())
    if clock.offset:
        clock = compare_clocks(laser.lags, odometry_lags, max(_delivery(files, topics.scan), laser.sweep()))
    if options.clock_offset is not None:
        clock = ClockFinding(options.clock_offset, clock.steady_lag, None)
    if laser.stamps and not laser.lags:
        read = f"first {laser.scans} " if survey.waited_in_vain else ""
        clock = clock._replace(warning=_UNSTAMPED.format(read))
    if clock.warning:
        logger.warning("%s: %s", files.paths[0], clock.warning)
    late_stamps = None
    if laser.lags and laser.unstamped:
        late_stamps = _FIRST_UNSTAMPED.format("scan has" if laser.unstamped == 1 else f"{laser.unstamped} scans have")
    limits = limits_warning(laser.first_scan.range_min, laser.first_scan.range_max)
    doubts = (
        *([topics.doubt] if topics.doubt else []),
        *_doubts(files, survey, frames, to_sensor if sensor_pose is None else None),
        *([times] if times is not None else []),
        *([late_stamps] if late_stamps is not None else []),
        *([limits] if limits and (options.range_min is None or options.range_max is None) else []),
        *files.pauses(),
    )
    for doubt in doubts:
        logger.warning("%s: %s", files.paths[0], doubt)
    stretched = angle_warning(len(laser.first_scan.ranges), laser.first_scan.angle_increment)
    if stretched and options.angle_step_deg is None:
        logger.warning("%s: %s", files.paths[0], stretched)
    unset = lags_of_unset(laser.lags, odometry_lags)
    return Plan(
        files, options, topics, laser, source, frames, robot_frame, to_sensor, sensor_pose, clock, unset, doubts, cut
    )


def _sliced(
    files: BagFiles, topics: ChosenTopics, options: RecordingOptions
) -> tuple[CloudSlice, RecordingOptions, str | None]:
    """Choose a slice of the point clouds; return it, the options for its scans, and a warning about their times.

    The height of the sensor depends on its frame and the robot's, so the beginning is surveyed twice.
    """
    clouds = files.first_clouds(topics.scan, _CLOUDS_TO_CHOOSE_BY)
    if not clouds:
        raise DatasetError(
            f"{files.paths[0]}: no cloud of {topics.scan} holds readable x, y and z: choose another --scan-topic"
        )
    files.slice_clouds(CloudSlice(SE3.identity(), -math.inf, math.inf))
    survey = _surveyed(files, topics, options)
    laser = _laser(files, options, topics, survey)
    frames = _frames(files, options, topics, survey, laser)
    _, to_sensor = _robot(survey, laser, options, frames)
    stated = None if to_sensor is None else pose_along(to_sensor)
    if stated is None and options.sensor_pose is None and is_optical(laser.frame):
        raise DatasetError(
            f"{files.paths[0]}: tf lacks the mount of {laser.frame}, the frame of {topics.scan}, so the heights of its "
            "points are unknown: record tf and tf_static, or pass --sensor-pose X Y DEG if the camera is level and "
            "looks in this direction"
        )
    T_robot_sensor = mounting(stated, options.sensor_pose, options.upside_down, laser.frame)
    own = [cloud for cloud in clouds if plain(cloud.frame) == laser.frame] or clouds
    named = f"{files.paths[0]}: the clouds of {topics.scan}"
    cut = choose_slice(
        T_robot_sensor,
        options.cloud_heights,
        options.angle_step_deg,
        own,
        named,
        laser.frame if stated is None else None,
    )
    known = stated is not None or options.sensor_pose is not None
    pose = cut.T_robot_scan if known else None
    return cut, replace(options, sensor_pose=pose, upside_down=False, angle_step_deg=None), times_warning(own)


def _surveyed(files: BagFiles, topics: ChosenTopics, options: RecordingOptions) -> Survey:
    """Read all static transforms of the recording, and as much of its beginning as is needed."""
    survey = Survey(options)
    static = [name for name in topics.transforms if is_static(name) and files.topics[name].messages <= _MOST_STATIC]
    for message in files.messages(static, topics.scan) if static else ():
        _take(survey, message)
    for message in files.messages([name for name in topics.all() if name not in static], topics.scan):
        _take(survey, message)
        if message.topic == topics.scan and survey.is_enough(message.bag_time):
            break
    return survey


def _take(survey: Survey, message: Message) -> None:
    if message.content is None:
        return
    if isinstance(message.content, FramedScan):
        survey.add_scan(message.content.frame, message.content.stamped(math.nan), message.bag_time)
    elif message.msgtype in TF_TYPES:
        for item in message.content:
            lag = message.bag_time - item.stamp_or(math.nan)
            survey.graph.add(item.parent, item.child, item.pose, is_static(message.topic), lag)
    else:
        for pose in message.content:
            survey.add_pose(pose.parent, pose.child, pose.pose, message.bag_time - pose.stamp_or(math.nan))
        survey.no_motions += not message.content


def _laser(files: BagFiles, options: RecordingOptions, topics: ChosenTopics, survey: Survey) -> SurveyedLaser:
    """Return the laser whose scans are read, and warn if the topic has scans of other lasers."""
    lasers = list(survey.lasers.values())
    if not lasers:
        raise DatasetError(f"{files.paths[0]}: no scan of {topics.scan} can be decoded: choose another --scan-topic")
    if survey.laser is None:
        listed = ", ".join(f"{laser.frame} ({in_number(laser.scans, 'scan', 'scans')})" for laser in lasers)
        raise DatasetError(
            f"{files.paths[0]}: no scan of {topics.scan} has the frame {options.laser_frame}; "
            f"there are {listed}: choose one with --laser-frame"
        )
    if len(lasers) > 1 and options.laser_frame is None:
        at_first = " at the beginning"
        listed = ", ".join(
            f"{laser.frame} ({laser.usable} of {laser.scans}{'' if number else at_first} hold hits)"
            for number, laser in enumerate(lasers)
        )
        logger.warning(
            "%s: %s holds scans of several lasers: %s; %s is used: pass --laser-frame for another",
            files.paths[0],
            topics.scan,
            listed,
            survey.laser.frame,
        )
    return survey.laser


def _frames(
    files: BagFiles, options: RecordingOptions, topics: ChosenTopics, survey: Survey, laser: SurveyedLaser
) -> Frames | None:
    """Return the frames of the odometry in tf, None if it is not read there.

    Points in a frame relative to which the robot moves, as those of registered clouds, are refused.
    """
    frames = survey.frames()
    if options.sensor_pose is None and survey.moves_in(laser.frame, frames):
        raise DatasetError(
            f"{files.paths[0]}: the points of {topics.scan} are in the frame {laser.frame}, in which the robot moves, "
            "so it is unknown from where the laser saw them: choose a topic in the laser's own frame with "
            "--scan-topic, or pass --sensor-pose if the frame's name is wrong"
        )
    return frames if options.odometry in ("auto", "tf") else None


def _source(
    files: BagFiles, options: RecordingOptions, topics: ChosenTopics, frames: Frames | None, survey: Survey
) -> str:
    constant = _only_velocities(files, topics, frames, survey)
    if frames is not None and (not constant or options.odom_frame is not None):
        return "tf"
    # The profile states a frame too, which may be missing.
    is_named = options.odom_frame is not None and options.odometry == "auto" and options.profile != "stata"
    if options.odometry == "tf" or is_named:
        known = ", ".join(survey.graph.frames()) or "no frames"
        name = options.odom_frame
        fact = "tf connects no odometry frame" if name is None else f"tf does not connect the frame {name}"
        raise DatasetError(
            f"{files.paths[0]}: {fact} with the robot; it has {known}: "
            "pass --odom-frame and --robot-frame, or --odometry topic"
        )
    if topics.odometry is not None:
        if constant:
            beside = "" if frames is None else ", like tf,"
            fact = f"{topics.odometry} holds velocities, but{beside} one and the same pose from first to last"
        elif survey.odometry_robot is not None or not survey.no_motions:  # its first pose may come late
            return "topic"
        else:
            fact = f"{topics.odometry} holds no valid poses (quaternions of zeros, or not a number)"
        if options.odometry == "topic":
            raise DatasetError(
                f"{files.paths[0]}: {fact}: choose another with --odometry-topic, or pass --odometry none"
            )
        logger.warning("%s: %s; continuing without odometry", files.paths[0], fact)
        return "none"
    if options.odometry == "auto":
        logger.warning("%s: neither tf nor a topic holds usable odometry; continuing without it", files.paths[0])
    return "none"


def _only_velocities(files: BagFiles, topics: ChosenTopics, frames: Frames | None, survey: Survey) -> bool:
    """Return whether the odometry holds velocities, but no poses: the robot moves by them, and no pose changes."""
    moving = [step.edge for step in frames.to_robot if not step.edge.is_fixed] if frames is not None else []
    if topics.odometry is None or survey.odometry_moves or any(edge.moves for edge in moving):
        return False
    transforms = [name for name in topics.transforms if moving and not is_static(name)]
    return holds_only_velocities(files, topics.odometry, transforms, [edge.key for edge in moving])


def _robot(
    survey: Survey, laser: SurveyedLaser, options: RecordingOptions, frames: Frames | None
) -> tuple[str | None, list[Step] | None]:
    """Return the robot's frame and the path from it to the laser."""
    if frames is not None:
        return frames.robot, frames.to_sensor
    robot = find_robot_frame(survey.graph, laser.frame, options, survey.odometry_robot)
    return robot, survey.graph.path(robot, laser.frame) if robot is not None else None


def _doubts(files: BagFiles, survey: Survey, frames: Frames | None, to_sensor: list[Step] | None) -> tuple[str, ...]:
    """Return warnings about the paths that are read from tf."""
    warnings = survey.graph.doubts([*(frames.to_robot if frames else []), *(to_sensor or [])])
    far = math.hypot(*Mounting(to_sensor, None, None, str(files.paths[0])).at(0.0)[0][:2])
    if far > _TOO_FAR:
        raise DatasetError(
            f"{files.paths[0]}: in tf the laser is mounted {far:.3g} m from the robot's centre: pass --sensor-pose"
        )
    if far > _FAR_LASER:
        warnings.append(
            f"in tf the laser is mounted {far:.0f} m from the robot's centre: pass --sensor-pose if that is wrong"
        )
    return tuple(warnings)


def _delivery(files: BagFiles, scan_topic: str) -> float:
    """Return the time from scan to record for another laser with a correct clock [s]; 0 if unknown.

    On the laser itself this delay cannot be separated from a wrong clock.
    """
    delays = []
    for other in files.of_type(SCAN_TYPE):
        if other.messages and other.name != scan_topic:
            messages = islice(files.messages([other.name], other.name), _SCANS_FOR_DELAY)
            lags = [
                m.bag_time - m.content.stamped(math.nan).stamp for m in messages if isinstance(m.content, FramedScan)
            ]
            delays.append(float(np.median(lags)) if lags else math.nan)
    return min((delay for delay in delays if 0.0 < delay < LATENCY_LIMIT_S), default=0.0)


def _odometry_lags(survey: Survey, frames: Frames | None, source: str) -> list[float]:
    """Return bag time minus stamp of the first messages of odometry [s]."""
    if source == "tf" and frames is not None:
        return next((step.edge.lags for step in frames.to_robot if not step.edge.is_fixed), [])
    return survey.odometry_lags if source == "topic" else []
