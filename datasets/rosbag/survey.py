"""Facts from the beginning of a recording: frames, clocks and lasers."""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from datasets.odometry.frames import KEPT_LAGS, FrameGraph, Frames, choose_frames, is_of_robot, plain
from datasets.odometry.se3 import SE3
from datasets.options import RecordingOptions
from datasets.scans.cleaning import FATES, RangeRules, clean_ranges
from datasets.scans.intake import RawScan

_KEPT_SCANS = 200
_RANGES_NEEDED = 100
_SCANS_TO_COMPARE = 20
_DIRECTIONS = 90
# On 17 recordings, the ranges of neighbouring scans of one laser differed by 0 to 4 %, and no more than those of every
# second scan. Scans of two robots, or of two lasers of a robot, differed by 25 and 41 %, and 20 to 30 times as much.
_UNLIKE = 0.1
_TIMES_AS_UNLIKE = 4.0
_SWEEP_SLACK = 1.1  # the speed of motors varies, and so do the stamps at both ends
# Percentile of the steps: above the short steps of scans that arrive in pairs, below the pauses after three scans.
_USUAL = 60.0
_PAUSE = 5.0  # usual steps beyond which a step is a pause


@dataclass
class SurveyedLaser:
    """Facts from the first scans of a laser."""

    frame: str
    first_scan: RawScan
    options: RecordingOptions
    scans: int = 0
    usable: int = 0
    """Number of scans with hits within the limits."""
    ranges: list[npt.NDArray[np.floating]] = field(default_factory=list)
    """Ranges (N,) of the first scans [m]."""
    stamps: list[float] = field(default_factory=list)
    lags: list[float] = field(default_factory=list)
    """Stamps of these scans (bag times where unset), and bag times minus stamps of the first that are set [s]."""
    unstamped: int = 0
    """Number of scans before the first whose stamp is set."""

    def add(self, scan: RawScan, bag_time: float) -> None:
        """Add a scan; its stamp is nan if it is unset."""
        rules = RangeRules.of(self.options)
        clean = clean_ranges(scan.ranges[None], *rules.limits(scan.range_min, scan.range_max), rules)
        self.scans += 1
        self.usable += bool(clean.beams[0, FATES.index("hit")])
        is_set = math.isfinite(scan.stamp)
        self.unstamped += not is_set and not self.lags
        if is_set and len(self.lags) < _KEPT_SCANS:
            self.lags.append(bag_time - scan.stamp)
        if len(self.ranges) < _KEPT_SCANS:
            self.ranges.append(np.array(scan.ranges))
            self.stamps.append(scan.stamp if is_set else bag_time)

    def sweep(self) -> float:
        """Return the time from the first beam of a scan to its last [s]; 0 if it is not stated."""
        stated = self.first_scan.time_increment * (len(self.first_scan.ranges) - 1)
        return stated if 0.0 < stated <= self.longest_sweep() else 0.0

    def longest_sweep(self) -> float:
        """Return the longest possible time from the first beam to the last [s]: little more than that to the next scan.

        Some lasers are read more often than they rotate; their time between beams is not the time of measurement.
        """
        steps = np.diff(self.stamps)
        steps = steps[steps > 0.0]
        if not len(steps):
            return math.inf
        # The mean, since the stamps of some lasers come in pairs, and their median is far from the period.
        usual = np.percentile(steps, _USUAL, method="lower")
        return _SWEEP_SLACK * float(steps[steps <= _PAUSE * usual].mean())

    def alternates(self) -> bool:
        """Return whether the scans of two lasers or robots alternate on the topic.

        Then a scan differs from the next, but not from the one after. For one laser, later scans differ more.
        """
        rows = [row for row in self.ranges if len(row)]
        if len(rows) < _SCANS_TO_COMPARE:
            return False
        directions = np.linspace(0.0, 1.0, _DIRECTIONS)
        scans = np.array([row[np.rint(directions * (len(row) - 1)).astype(np.int64)] for row in rows])
        scans[~(np.isfinite(scans) & (scans > 0.0))] = np.nan
        next_one, next_but_one = (_unlikeness(scans[:-2], scans[step:][: len(scans) - 2]) for step in (1, 2))
        return bool(next_one > _UNLIKE and next_one > _TIMES_AS_UNLIKE * next_but_one)

    def nearest_usual(self) -> float:
        """Return the length [m] that nine of ten different ranges exceed; 0 if unknown. A code counts once."""
        values = np.unique(np.concatenate([scan[np.isfinite(scan) & (scan > 0.0)] for scan in self.ranges]))
        return float(np.percentile(values, 10)) if len(values) >= _RANGES_NEEDED else 0.0

    def range_rules(self) -> RangeRules:
        """Return the rules for reading ranges, with a no-return code found in the data."""
        rules = RangeRules.of(self.options)
        _, high = rules.limits(self.first_scan.range_min, self.first_scan.range_max)
        return rules.with_code_of(self.ranges, high)


def _unlikeness(scans: npt.NDArray[np.floating], others: npt.NDArray[np.floating]) -> float:
    """Return the median relative difference of two rows of scans (S, D), nan without a hit; 0 if unknown."""
    both = np.isfinite(scans) & np.isfinite(others)
    shares = np.where(both, np.abs(scans - others) / np.where(both, np.maximum(scans, others), 1.0), np.nan)
    shares = shares[both.sum(axis=1) >= _DIRECTIONS // 4]
    return float(np.median(np.nanmedian(shares, axis=1))) if len(shares) else 0.0


_SCANS_NEEDED = 40
_STAMPS_NEEDED = 20
_POSES_NEEDED = 10
_SECONDS_NEEDED = 4.0
_SECONDS_AT_MOST = 60.0
# Simulations leave stamps at zero until they hear their clock, mostly for seconds. Some drivers never set any, and a
# wait for them would decode the whole recording once more.
_WAIT_FOR_STAMPS_S = 300.0


@dataclass
class Survey:
    """Facts from the first messages."""

    options: RecordingOptions
    graph: FrameGraph = field(default_factory=FrameGraph)
    odometry_robot: str | None = None
    """Robot's frame by the first pose of the odometry topic, which may be empty; None before it."""
    odometry_frame: str = ""
    """Frame in which the first pose of the odometry topic is stated."""
    odometry_lags: list[float] = field(default_factory=list)
    """Bag times minus stamps of its first poses [s]."""
    first_pose: SE3 | None = None
    odometry_moves: bool = False
    """First pose of the odometry topic, and whether another differs from it."""
    no_motions: int = 0
    """Number of its messages that state no motion."""
    lasers: dict[str, SurveyedLaser] = field(default_factory=dict)
    """Facts about each laser by its frame, in the order of their first scans."""
    started_at: float | None = None
    waited_in_vain: bool = False
    """Whether the survey ended without the stamps that it waited for."""

    @property
    def laser(self) -> SurveyedLaser | None:
        """The chosen laser, or else the first laser with most usable scans; None if there is none."""
        if self.options.laser_frame is not None:
            return self.lasers.get(plain(self.options.laser_frame))
        return max(self.lasers.values(), key=lambda laser: laser.usable, default=None)

    def add_scan(self, frame: str, scan: RawScan, bag_time: float) -> None:
        """Add a scan; its stamp is nan if it is unset."""
        name = plain(frame)
        if name not in self.lasers:
            self.lasers[name] = SurveyedLaser(name, scan, self.options)
        self.lasers[name].add(scan, bag_time)

    def add_pose(self, frame: str, robot: str, pose: SE3, lag: float) -> None:
        """Add a pose of the odometry topic; its lag is nan if its stamp is unset."""
        if self.odometry_robot is None:
            self.odometry_frame, self.odometry_robot = plain(frame), robot
        self.first_pose = pose if self.first_pose is None else self.first_pose
        self.odometry_moves = self.odometry_moves or pose != self.first_pose
        if len(self.odometry_lags) < KEPT_LAGS and math.isfinite(lag):
            self.odometry_lags.append(lag)

    def frames(self) -> Frames | None:
        """Return the chosen frames."""
        return choose_frames(self.graph, self.laser.frame if self.laser is not None else "", self.options)

    def moves_in(self, frame: str, frames: Frames | None) -> bool:
        """Return whether the robot moves relative to a frame, by the odometry in tf or else by that of the topic."""
        if frames is not None:
            moving = [step.edge.key for step in frames.to_robot if not step.edge.is_fixed]
            return any(step.edge.key in moving for step in self.graph.path(frame, frames.robot, True) or [])
        if self.odometry_frame in ("", plain(self.odometry_robot or "")) or is_of_robot(self.odometry_frame):
            return False  # the topic states no frame, or a wrong one
        path = self.graph.path(frame, self.odometry_frame, True)
        return path is not None and all(step.down for step in path)

    def is_enough(self, bag_time: float) -> bool:
        """Return whether the survey needs no more of the recording."""
        self.started_at = bag_time if self.started_at is None else self.started_at
        seconds = bag_time - self.started_at
        if seconds < _SECONDS_NEEDED or self.laser is None or len(self.laser.ranges) < _SCANS_NEEDED:
            return False
        if len(self.laser.lags) < _STAMPS_NEEDED:
            self.waited_in_vain = seconds > _WAIT_FOR_STAMPS_S
            return self.waited_in_vain
        if seconds > _SECONDS_AT_MOST or self.options.odometry in ("topic", "none"):
            return True
        frames = self.frames()
        if frames is None or max(step.edge.count for step in frames.to_robot if not step.edge.static) < _POSES_NEEDED:
            return False
        return frames.to_sensor is not None or self.options.sensor_pose is not None
