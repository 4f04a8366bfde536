"""ROS 1 and ROS 2 bags as recordings."""

import logging
import math
from collections.abc import Iterator
from pathlib import Path

from datasets.counts import ReadingCounts, in_number
from datasets.odometry.frames import plain
from datasets.odometry.source import Mounting, NoMotion, TfMotion, TopicMotion
from datasets.odometry.synchronisation import EXTRAPOLATION_LIMIT_S, Pairing
from datasets.options import RecordingOptions
from datasets.recording import Recording, in_blocks
from datasets.rosbag.files import BagFiles, Message
from datasets.rosbag.messages import CLOUD_TYPE, ECHOES_TYPE, SCAN_TYPE, TF_TYPES, FramedScan
from datasets.rosbag.plan import Plan, plan_reading
from datasets.salvage.salvaged_bag import UNKNOWN_LOSS
from datasets.scans.clocks import ClockSteps
from datasets.scans.intake import CleanScan, ScanIntake, angle_warning
from tbmslam.sensing.laser_scan import Reading

logger = logging.getLogger(__name__)


def open_rosbags(paths: list[Path], options: RecordingOptions) -> Recording:
    """Open ROS 1 bag files, or ROS 2 bag directories or storage files, as one recording, merged by time."""
    plan = plan_reading(BagFiles(paths), options)
    recording = Recording(
        paths[0].stem if paths[0].is_file() else paths[0].name,
        lambda counts: _Pass(plan, counts).readings(),
        _description(plan),
        plan.files.topics[plan.topics.scan].messages,
    )
    logger.info("%s: %s", recording.name, recording.description)
    return recording


class _Pass:
    """One reading of a bag from beginning to end."""

    def __init__(self, plan: Plan, counts: ReadingCounts) -> None:
        options = plan.options
        step = math.radians(options.angle_step_deg) if options.angle_step_deg is not None else None
        mounting = Mounting(plan.to_sensor, plan.sensor_pose, options.upside_down, str(plan.files.paths[0]))
        self._plan = plan
        self._counts = counts
        self._clock = ClockSteps(plan.clock.steady_lag, counts)
        laser = plan.laser
        self._intake = ScanIntake(laser.range_rules(), step, options.gap_s, counts, laser.longest_sweep())
        self._motion = _motion(plan, mounting)
        self._pairing = Pairing(
            self._motion, counts, plan.clock.offset, options.odometry_scale, options.max_odometry_gap_s
        )

    def readings(self) -> Iterator[Reading]:
        """Yield the readings in the order of the recording."""
        plan = self._plan
        try:
            for block in in_blocks(plan.files.messages(plan.topics_to_read(), plan.topics.scan)):
                scans = [message.content.scan for message in block if isinstance(message.content, FramedScan)]
                cleaned = iter(self._intake.cleaned(scans))
                for message in block:
                    self._take(message, cleaned)
                    yield from self._pairing.ready(message.bag_time)
        finally:
            plan.files.close()
        yield from self._pairing.rest()
        self._note_damage()
        if others := self._counts.dropped.get("other_frame"):
            logger.warning(
                "%s: %d scans of lasers other than %s are ignored", plan.files.paths[0], others, plan.laser.frame
            )
        if self._counts.clock_disagreements:
            logger.warning(
                "%s: %d scans have stamps that jump relative to the bag's clock, which is used for them",
                plan.files.paths[0],
                self._counts.clock_disagreements,
            )

    def _note_damage(self) -> None:
        """Count and report the losses of damaged files."""
        files, topic, vague = self._plan.files, self._plan.topics.scan, False
        for loss in files.losses(topic):
            self._counts.lost_seconds += loss.seconds
            self._counts.lost_scans += loss.messages
            self._counts.incidents.add(loss.since, "scans are lost in the damaged file", loss.seconds)
            vague = vague or not loss.messages
        for line in files.notes():
            logger.warning("%s", line)
        lost, seconds = self._counts.lost_scans, self._counts.lost_seconds
        announced = files.topics[topic].messages + lost
        missing = announced - self._counts.scans_read
        if missing > 0 and not files.damages():
            logger.warning("%s: %d of %d scans that it announces are missing", files.paths[0], missing, announced)
        estimate = (
            f"about {in_number(lost, 'scan', 'scans')}, {seconds:.1f} s, lost" if lost else "no scan seems to be lost"
        )
        for line in files.damages():
            known = "some are lost" if (vague or UNKNOWN_LOSS in line) and not lost else estimate
            logger.warning("%s; %s read, %s", line, in_number(self._counts.scans_read, "scan was", "scans were"), known)

    def _take(self, message: Message, cleaned: Iterator[CleanScan]) -> None:
        """Add the scan, the transforms or the odometry of a message; count unreadable scans."""
        content, unset = message.content, message.bag_time - self._plan.unset_lags[1]
        if isinstance(content, FramedScan):
            self._take_scan(content, message.bag_time, next(cleaned))
        elif content is None:
            if message.msgtype in (SCAN_TYPE, ECHOES_TYPE, CLOUD_TYPE):
                self._counts.scans_read += 1
                self._counts.drop("unreadable")
        elif message.msgtype in TF_TYPES:
            for item in content:
                self._motion.add_transform(item.parent, item.child, item.stamp_or(unset), item.pose)
        elif isinstance(self._motion, TopicMotion):
            for item in content:
                self._motion.add(item.stamp_or(unset), item.pose)

    def _take_scan(self, framed: FramedScan, bag_time: float, clean: CleanScan) -> None:
        """Correct the stamp of a clean scan and queue the scan until its odometry is known."""
        if plain(framed.frame) != self._plan.laser.frame:
            self._counts.scans_read += 1
            self._counts.drop("other_frame")
            return
        raw = framed.stamped(bag_time - self._plan.unset_lags[0])
        stamp = self._clock.corrected(raw.stamp, bag_time)
        if stamp != raw.stamp:
            raw = raw._replace(stamp=stamp)
        scan = self._intake.take(raw, clean)
        if scan is not None:
            self._pairing.add(scan, bag_time)


def _motion(plan: Plan, mounting: Mounting) -> TfMotion | TopicMotion | NoMotion:
    """Return an empty store of odometry for one pass."""
    if plan.source == "tf" and plan.frames is not None:
        return TfMotion(plan.frames, mounting)
    return TopicMotion(mounting) if plan.source == "topic" else NoMotion(mounting)


def _description(plan: Plan) -> dict[str, object]:
    """Return the choices and findings as JSON can hold them."""
    mounting, upside_down = Mounting(plan.to_sensor, plan.sensor_pose, plan.options.upside_down).at(0.0)
    rules = plan.laser.range_rules()
    first = plan.laser.first_scan
    stated = {
        "beams": len(first.ranges),
        "angle_min_deg": math.degrees(first.in_radians().angle_min),
        "angle_step_deg": math.degrees(first.in_radians().angle_increment),
        "range_min_m": first.range_min,
        "range_max_m": first.range_max,
        "angle_warning": angle_warning(len(first.ranges), first.angle_increment),
        "time_increment_s": first.time_increment if math.isfinite(first.time_increment) else None,
    }
    return {
        "kind": "rosbag",
        "paths": [str(path) for path in plan.files.paths],
        "profile": plan.options.profile,
        "scan_topic": plan.topics.scan,
        "first_scan": stated,
        "sensor_frame": plan.laser.frame,
        "odometry": plan.source,
        "odometry_topic": plan.topics.odometry if plan.source == "topic" else None,
        "odom_frame": plan.frames.odom if plan.frames else None,
        "robot_frame": plan.robot_frame,
        "T_robot_sensor": list(mounting),
        "sensor_pose_known": plan.to_sensor is not None or plan.options.sensor_pose is not None,
        "cloud_heights_m": None if plan.cut is None else [plan.cut.low, plan.cut.high],
        "cloud_opening": None if plan.cut is None else plan.cut.opening,
        "upside_down": upside_down,
        "angle_step_deg": plan.options.angle_step_deg,
        "range_min_m": rules.range_min,
        "range_max_m": rules.range_max,
        "range_offset_m": rules.offset,
        "no_return": rules.no_return,
        "no_return_codes_m": list(rules.no_return_codes),
        "odometry_scale": plan.options.odometry_scale,
        "clock_offset_s": plan.clock.offset,
        "clock_warning": plan.clock.warning,
        "frame_warnings": list(plan.doubts),
        "extrapolation_limit_s": EXTRAPOLATION_LIMIT_S,
        "max_odometry_gap_s": plan.options.max_odometry_gap_s,
    }
