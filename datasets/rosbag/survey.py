"""What the beginning of a recording tells: frames, clocks and lasers."""

import math
from collections import Counter
from dataclasses import dataclass, field

from datasets.odometry.frames import FrameGraph, Frames, choose_frames, plain
from datasets.options import RecordingOptions
from datasets.rosbag.surveyed_laser import SurveyedLaser
from datasets.scans.intake import RawScan

_SCANS_NEEDED = 40
_POSES_NEEDED = 10
_SECONDS_NEEDED = 4.0
_SECONDS_AT_MOST = 60.0


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
    lasers: dict[str, SurveyedLaser] = field(default_factory=dict)
    """What was seen of each laser, by its frame, in the order of their first scans."""
    started_at: float | None = None

    @property
    def laser(self) -> SurveyedLaser | None:
        """The laser asked for, or else that with most usable scans, of several the first; None if it was not seen."""
        if self.options.laser_frame is not None:
            return self.lasers.get(plain(self.options.laser_frame))
        return max(self.lasers.values(), key=lambda laser: laser.usable, default=None)

    def add_scan(self, frame: str, scan: RawScan, bag_time: float) -> None:
        """Take in a scan; its stamp is nan where it is unset."""
        name = plain(frame)
        if name not in self.lasers:
            self.lasers[name] = SurveyedLaser(name, scan, self.options)
        self.lasers[name].add(scan, bag_time)

    def add_pose(self, topic: str, frame: str, robot: str, lag: float) -> None:
        """Take in a message of an odometry topic; its lag is nan where its stamp is unset."""
        self.pose_topics.setdefault(topic, PoseTopic(frame, robot)).lags.extend([lag] * math.isfinite(lag))

    def frames(self) -> Frames | None:
        """Return the frames chosen so far."""
        return choose_frames(self.graph, self.laser.frame if self.laser is not None else "", self.options)

    def is_enough(self, bag_time: float) -> bool:
        """Return whether the rest of the recording need not be looked at."""
        self.started_at = bag_time if self.started_at is None else self.started_at
        seconds = bag_time - self.started_at
        if seconds < _SECONDS_NEEDED or self.laser is None or len(self.laser.ranges) < _SCANS_NEEDED:
            return False
        if seconds > _SECONDS_AT_MOST or self.options.odometry in ("topic", "none"):
            return True
        frames = self.frames()
        if frames is None or max(step.edge.count for step in frames.to_robot if not step.edge.static) < _POSES_NEEDED:
            return False
        return frames.to_sensor is not None or self.options.sensor_pose is not None
