"""Logs of CARMEN and of CMU's robotics course as recordings of scans and poses."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from datasets.carmen_lines import SCAN_KINDS, LoggedScan, LogSettings, kind_of, pose_from, scan_from
from datasets.counts import ReadingCounts
from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from datasets.odometry.source import Mounting, TopicMotion
from datasets.odometry.synchronisation import Pairing, scaled, turned_over
from datasets.options import RecordingOptions
from datasets.recording import Recording, in_blocks
from datasets.scans.cleaning import RangeRules
from datasets.scans.intake import ScanIntake
from datasets.text_files import lines_of
from tbmslam.geometry.se2 import SE2, median_pose, stacked
from tbmslam.sensing.laser_scan import LaserScan, Reading

logger = logging.getLogger(__name__)

_SAMPLE_EVERY = 10
_MOST_SAMPLES = 2000
_LARGEST_PARAMETER = 1000.0  # of places on a robot and limits of a laser [m]
_OFFSET_PARAM = "robot_frontlaser_offset"
_RANGE_PARAMS = ("robot_front_laser_max", "laser_front_laser_max")
_UNTIMED = "the scans have no usable times, so they are taken as one second apart"


@dataclass
class _LogSurvey:
    """Facts from one pass over the lines."""

    numbers: dict[str, int] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    samples: dict[str, list[str]] = field(default_factory=dict)


def open_carmen(paths: list[Path], options: RecordingOptions) -> Recording:
    """Open logs, plain or compressed by gzip, bzip2 or xz, as one recording, one after another.

    `options.scan_topic` names the kind of line. Options of frames and tf do not apply. Raises a `DatasetError` if the
    files hold no scan of the requested kind.
    """
    survey = _surveyed(paths)
    kind = _kind(paths, survey, options)
    settings = _settings(survey, kind)
    if kind == "RAWLASER1" and "ODOM" not in survey.numbers and options.odometry != "none":
        logger.warning("%s: no line of ODOM holds odometry; continuing without it", paths[0])
        options = replace(options, odometry="none")
    samples = _sampled(survey.samples[kind], settings)
    rules = _range_rules(samples, options, settings)
    mount = options.sensor_pose or _median_mount(samples, settings)
    recording = Recording(
        paths[0].name.split(".")[0],
        lambda counts: _readings(paths, kind, settings, rules, options, mount, counts),
        _description(paths, kind, settings, rules, options, mount, samples),
        survey.numbers[kind],
    )
    logger.info("%s: %s", recording.name, recording.description)
    if settings.times == "none":
        logger.warning("%s: %s", paths[0], _UNTIMED)
    return recording


def _surveyed(paths: list[Path]) -> _LogSurvey:
    """Count the kinds of lines, keep some scans of all parts of the drive, and the parameters."""
    survey = _LogSurvey()
    for line in (line for path in paths for line in lines_of(path)):
        kind = kind_of(line)
        if kind in SCAN_KINDS or kind == "ODOM":
            number = survey.numbers.get(kind, 0)
            survey.numbers[kind] = number + 1
            kept = survey.samples.setdefault(kind, [])
            if number % _SAMPLE_EVERY == 0 and len(kept) < _MOST_SAMPLES:
                kept.append(line)
        elif kind == "PARAM":
            _note_parameter(survey, line)
    return survey


def _note_parameter(survey: _LogSurvey, line: str) -> None:
    """Keep a parameter that is a number."""
    words = line.split()
    try:
        value = float(words[2].replace(",", "."))
    except (ValueError, IndexError):
        return
    if abs(value) <= _LARGEST_PARAMETER:
        survey.parameters[words[1]] = value


def _kind(paths: list[Path], survey: _LogSurvey, options: RecordingOptions) -> str:
    """Return the kind of lines that hold the scans."""
    there = [kind for kind in SCAN_KINDS if kind in survey.numbers]
    names = ", ".join(str(path) for path in paths)
    if not there:
        raise DatasetError(f"{names}: no ROS bag, and no line of {', '.join(SCAN_KINDS)}: give a laser recording")
    if options.scan_topic is None:
        return there[0]
    if options.scan_topic not in there:
        raise DatasetError(f"{names} has no {options.scan_topic}; it has {', '.join(there)}: choose with --scan-topic")
    return options.scan_topic


def _settings(survey: _LogSurvey, kind: str) -> LogSettings:
    range_max = next((survey.parameters[n] for n in _RANGE_PARAMS if n in survey.parameters), LogSettings().range_max)
    settings = LogSettings(survey.parameters.get(_OFFSET_PARAM, 0.0), range_max)
    lines = survey.samples[kind]
    for times in ("ipc", "logger", "none"):
        settings = settings._replace(times=times)
        scans = _sampled(lines, settings)
        if scans and _tell_times([scan.raw.stamp for scan in scans]):
            break
    first = settings._replace(odometry="first")
    is_first = kind == "FLASER" and _is_constant(scans) and not _is_constant(_sampled(lines, first))
    return first if is_first else settings


def _tell_times(stamps: list[float]) -> bool:
    """Return whether stamps of scans, far apart in the log, are times: some are all zero, or were rounded to days."""
    repeated = sum(stamp == after for stamp, after in pairwise(stamps))
    return len(stamps) == 1 or (max(stamps) > 0.0 and 2 * repeated < len(stamps) - 1)


def _is_constant(scans: list[LoggedScan]) -> bool:
    """Return whether the odometry of several scans never changes."""
    return len(scans) > 1 and len({scan.T_odom_robot for scan in scans}) == 1


def _sampled(lines: list[str], settings: LogSettings) -> list[LoggedScan]:
    """Read the sampled lines that can be read."""
    return [scan for line in lines if (scan := _read(line, settings)) is not None]


def _read(line: str, settings: LogSettings) -> LoggedScan | None:
    """Read a scan; None if its line is damaged."""
    try:
        return scan_from(_with_points(line), settings)
    except (ValueError, IndexError, OverflowError):
        return None


def _with_points(line: str) -> str:
    """Return a line with decimal points, since some computers wrote commas."""
    return line.replace(",", ".") if "," in line else line


def _range_rules(samples: list[LoggedScan], options: RecordingOptions, settings: LogSettings) -> RangeRules:
    """Return the rules for reading ranges, with a no-return code found in the data."""
    ranges = [np.asarray(sample.raw.ranges, dtype=np.float64) for sample in samples]
    return RangeRules.of(options).with_code_of(ranges, options.range_max or settings.range_max)


def _median_mount(samples: list[LoggedScan], settings: LogSettings) -> SE2:
    """Return the median T_robot_sensor of some lines, or the one of the settings without a line."""
    if not samples:
        return SE2(settings.laser_offset, 0.0, 0.0)
    return median_pose(stacked([logged.T_robot_sensor for logged in samples]))


def _readings(
    paths: list[Path],
    kind: str,
    settings: LogSettings,
    rules: RangeRules,
    options: RecordingOptions,
    mount: SE2,
    counts: ReadingCounts,
) -> Iterator[Reading]:
    """Yield the readings of one pass in the order of the lines.

    If odometry is looked up by time, each line of a scan also adds its pose to the odometry.
    """
    step = math.radians(options.angle_step_deg) if options.angle_step_deg is not None else None
    looks_up = _looks_up(kind, options)
    intake = ScanIntake(rules, step, options.gap_s, counts)
    motion = TopicMotion(Mounting([], mount, options.upside_down))
    # A pose in the line of each scan is near in time, however far apart the scans are.
    longest_gap_s = options.max_odometry_gap_s if kind == "RAWLASER1" else math.inf
    pairing = Pairing(motion, counts, options.clock_offset or 0.0, options.odometry_scale, longest_gap_s)
    for block in in_blocks(line for path in paths for line in lines_of(path)):
        kinds = [kind_of(line) for line in block]
        logs = [_read(line, settings) if own == kind else None for own, line in zip(kinds, block, strict=True)]
        cleaned = iter(intake.cleaned([logged.raw for logged in logs if logged is not None]))
        for own, line, logged in zip(kinds, block, logs, strict=True):
            if own == kind:
                if logged is None:
                    counts.scans_read += 1
                    counts.drop("unreadable")
                    continue
                raw = logged.raw
                if settings.times == "none":
                    raw = raw._replace(stamp=float(counts.scans_read))
                scan = intake.take(raw, next(cleaned))
                if looks_up and logged.T_odom_robot is not None:
                    motion.add(raw.stamp, SE3.from_planar(logged.T_odom_robot))
                if scan is None:
                    continue
                if looks_up:
                    pairing.add(scan, scan.stamp)
                    yield from pairing.ready(scan.stamp)
                else:
                    counts.scans_used += 1
                    yield _reading(scan, logged, options)
            elif kind == "RAWLASER1" and own == "ODOM":
                _add_pose(motion, line, settings, counts.scans_read)
                yield from pairing.ready(float("-inf"))
    yield from pairing.rest()


def _looks_up(kind: str, options: RecordingOptions) -> bool:
    """Return whether odometry is looked up by time, instead of taken from the line of the scan."""
    return options.odometry != "none" and (kind == "RAWLASER1" or bool(options.clock_offset))


def _reading(scan: LaserScan, logged: LoggedScan, options: RecordingOptions) -> Reading:
    scan = turned_over(scan) if options.upside_down else scan
    odometry = None
    if options.odometry != "none" and logged.T_odom_robot is not None:
        odometry = scaled(logged.T_odom_robot, options.odometry_scale)
    return Reading(scan, odometry, options.sensor_pose or logged.T_robot_sensor)


def _add_pose(motion: TopicMotion, line: str, settings: LogSettings, number: int) -> None:
    """Add a line of odometry before the scan of a number, unless it is damaged."""
    try:
        stamp, T_odom_robot = pose_from(_with_points(line), settings)
    except (ValueError, IndexError):
        return
    motion.add(float(number) if settings.times == "none" else stamp, SE3.from_planar(T_odom_robot))


def _description(
    paths: list[Path],
    kind: str,
    settings: LogSettings,
    rules: RangeRules,
    options: RecordingOptions,
    mount: SE2,
    samples: list[LoggedScan],
) -> dict[str, object]:
    """Return the choices and findings for JSON."""
    first = samples[0] if samples else None
    step = options.angle_step_deg
    if step is None and first is not None:
        step = math.degrees(first.raw.angle_increment)
    source = "none" if options.odometry == "none" else "ODOM" if kind == "RAWLASER1" else kind
    return {
        "kind": "carmen",
        "paths": [str(path) for path in paths],
        "scan_topic": kind,
        "odometry": source,
        "odometry_scale": options.odometry_scale,
        "beams": len(first.raw.ranges) if first is not None else None,
        "angle_step_deg": step,
        "T_robot_sensor": list(mount),
        "upside_down": bool(options.upside_down),
        "times": settings.times,
        "clock_offset_s": (options.clock_offset or 0.0) if _looks_up(kind, options) else None,
        "clock_warning": _UNTIMED if settings.times == "none" else None,
        "range_min_m": rules.range_min,
        "range_offset_m": rules.offset,
        "range_max_m": rules.range_max or (first.raw.range_max if first is not None else settings.range_max),
        "no_return": rules.no_return,
        "no_return_codes_m": list(rules.no_return_codes),
    }
