"""What the beginning of a recording tells: frames, clocks and the codes of the laser."""

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from datasets.cleaning import KNOWN_CODES, RangeRules, find_no_return_code
from datasets.frames import FrameGraph, Frames, choose_frames, plain
from datasets.options import RecordingOptions
from datasets.scan_intake import RawScan

_KEPT_SCANS = 200
_SCANS_NEEDED = 40
_RANGES_NEEDED = 100
_POSES_NEEDED = 10
_SECONDS_NEEDED = 4.0
_SECONDS_AT_MOST = 60.0
_SWEEP_SLACK = 1.1  # stamps jitter


@dataclass
class PoseTopic:
    """What the survey saw of an odometry topic; names of frames may be empty."""

    frame: str
    robot: str
    lags: list[float] = field(default_factory=list)


@dataclass
class Survey:
    """Facts from the first messages.

    Parameters
    ----------
    options
        The choices already made.
    """

    options: RecordingOptions
    graph: FrameGraph = field(default_factory=FrameGraph)
    pose_topics: dict[str, PoseTopic] = field(default_factory=dict)
    no_motions: Counter[str] = field(default_factory=Counter)
    """Messages of odometry topics that state no motion."""
    sensor_frame: str | None = None
    first_scan: RawScan | None = None
    ranges: list[npt.NDArray[np.floating]] = field(default_factory=list)
    scan_lags: list[float] = field(default_factory=list)
    scan_stamps: list[float] = field(default_factory=list)
    started_at: float | None = None

    def add_scan(self, frame: str, scan: RawScan, bag_time: float) -> None:
        """Take in a scan; its stamp is nan where it is unset."""
        if self.sensor_frame is None:
            self.sensor_frame, self.first_scan = plain(frame), scan
        if len(self.ranges) < _KEPT_SCANS:
            self.ranges.append(np.array(scan.ranges))
            is_set = math.isfinite(scan.stamp)
            self.scan_lags += [bag_time - scan.stamp] * is_set
            self.scan_stamps.append(scan.stamp if is_set else bag_time)

    def add_pose(self, topic: str, frame: str, robot: str, lag: float) -> None:
        """Take in a message of an odometry topic; its lag is nan where its stamp is unset."""
        self.pose_topics.setdefault(topic, PoseTopic(frame, robot)).lags.extend([lag] * math.isfinite(lag))

    def frames(self) -> Frames | None:
        """Return the frames chosen so far."""
        return choose_frames(self.graph, self.sensor_frame or "", self.options)

    def is_enough(self, bag_time: float) -> bool:
        """Return whether the rest of the recording need not be looked at."""
        self.started_at = bag_time if self.started_at is None else self.started_at
        seconds = bag_time - self.started_at
        if seconds < _SECONDS_NEEDED or len(self.ranges) < _SCANS_NEEDED:
            return False
        if seconds > _SECONDS_AT_MOST or self.options.odometry in ("topic", "none"):
            return True
        frames = self.frames()
        if frames is None or max(step.edge.count for step in frames.to_robot if not step.edge.static) < _POSES_NEEDED:
            return False
        return frames.to_sensor is not None or self.options.sensor_pose is not None

    def longest_sweep(self) -> float:
        """Return how long a scan can take from its first beam to its last [s]: not much longer than the next is away.

        A laser that is read out more often than it turns states a time between beams that does not say when a beam
        was sent.
        """
        steps = np.diff(self.scan_stamps)
        steps = steps[steps > 0.0]
        return _SWEEP_SLACK * float(np.median(steps)) if len(steps) else math.inf

    def nearest_usual(self) -> float:
        """Return the length [m] that nine of ten ranges exceed, each counted once as it may be a code; 0: unknown."""
        values = np.unique(np.concatenate([scan[np.isfinite(scan) & (scan > 0.0)] for scan in self.ranges]))
        return float(np.percentile(values, 10)) if len(values) >= _RANGES_NEEDED else 0.0

    def range_rules(self) -> RangeRules:
        """Return how ranges are to be read, with a no-return code found in the data."""
        options = self.options
        codes = (*KNOWN_CODES, *options.no_return_codes)
        rules = RangeRules(options.range_min, options.range_max, codes, options.no_return, options.range_offset)
        if self.first_scan is None:
            return rules
        _, high = rules.limits(self.first_scan.range_min, self.first_scan.range_max)
        found = find_no_return_code([scan[scan < high] for scan in self.ranges], codes)
        return rules if found is None else replace(rules, no_return_codes=(*codes, found))
