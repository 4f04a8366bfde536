"""Division of one recording into several robots: the readings of each robot, and its private frame."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.sensing.laser_scan import Reading

_FEW = 10  # least number of readings for the usual interval


class SegmentationError(TbmSlamError):
    """The recording cannot be split as requested."""


class Segment(NamedTuple):
    """Readings `start` (included) to `stop` (excluded) of a recording, by their index."""

    start: int
    stop: int


@dataclass(frozen=True)
class Itinerary:
    """The stamps and the travelled distance of a recording."""

    stamps: FloatArray
    """Stamp (N,) of every reading [s]."""
    travelled: FloatArray
    """Distance (N,) driven until each reading by its odometry [m]; all zero without odometry."""

    @classmethod
    def from_poses(cls, stamps: Sequence[float], poses: Sequence[SE2 | None]) -> "Itinerary":
        """Read stamps and distances from the stamps and poses of a first pass over a recording."""
        steps = [0.0]
        for before, after in itertools.pairwise(poses):
            if before is None or after is None:
                steps.append(0.0)
            else:
                steps.append(math.hypot(after.x - before.x, after.y - before.y))
        return cls(np.asarray(stamps, dtype=np.float64), np.cumsum(steps[: len(stamps)]))


def split_by_distance(itinerary: Itinerary, robots: int, overlap: float) -> list[Segment]:
    """Split into robots of equal distance; neighbours share the fraction `overlap` of their distance.

    Without odometry the time takes the distance's place.
    """
    if len(itinerary.travelled) and itinerary.travelled[-1] > 0.0:
        return _split_evenly(itinerary.travelled, robots, overlap)
    return split_by_time(itinerary, robots, overlap)


def split_by_time(itinerary: Itinerary, robots: int, overlap: float) -> list[Segment]:
    """Split into robots of equal duration; neighbours share the fraction `overlap` of their time."""
    passed = np.cumsum(np.concatenate(([0.0], _time_steps(itinerary.stamps))))
    return _split_evenly(passed[: len(itinerary.stamps)], robots, overlap)


def split_at_gaps(itinerary: Itinerary, gap_s: float) -> list[Segment]:
    """Begin a new robot after each gap [s]; raise a `SegmentationError` if most readings would each be a robot."""
    if not gap_s > 0.0:
        raise ValueError(f"gap_s must be positive, got {gap_s}")
    count, steps = len(itinerary.stamps), _time_steps(itinerary.stamps)
    if count > _FEW and (usual := float(np.median(steps))) > gap_s:
        raise SegmentationError(
            f"a gap of {gap_s:g} s is shorter than the usual {usual:.3g} s between readings, so each reading would "
            f"be a robot: pass a longer --gap"
        )
    cuts = [0, *(np.flatnonzero(steps > gap_s) + 1).tolist(), count]
    return [Segment(start, stop) for start, stop in itertools.pairwise(cuts) if stop > start]


def split_at_intervals(itinerary: Itinerary, intervals: Sequence[tuple[float, float]]) -> list[Segment]:
    """Assign an interval of time to each robot, in seconds since the first reading; intervals may overlap.

    Raises a `SegmentationError` if an interval has no reading.
    """
    since = itinerary.stamps - itinerary.stamps[:1]
    segments = []
    for begin, end in intervals:
        inside = np.flatnonzero((since >= begin) & (since < end))
        if not len(inside):
            raise SegmentationError(
                f"no reading lies between {begin:g} s and {end:g} s: the recording lasts "
                f"{since[-1] if len(since) else 0.0:.1f} s"
            )
        segments.append(Segment(int(inside[0]), int(inside[-1]) + 1))
    return segments


def private_frame(seed: int, robot: int) -> SE2:
    """Return T_private_start, a robot's own frame, with a random rotation and a shift of up to 10 m along each axis."""
    generator = np.random.default_rng((seed, robot))
    x, y = generator.uniform(-10.0, 10.0, size=2)
    return SE2(float(x), float(y), float(generator.uniform(-np.pi, np.pi)))


def in_frame(reading: Reading, T_new_odom: SE2) -> Reading:
    """Return the reading with its odometry in another frame."""
    if reading.T_odom_robot is None:
        return reading
    swept = None if reading.T_odom_swept is None else T_new_odom @ reading.T_odom_swept
    # dataclasses.replace takes several times as long, and this runs for every reading.
    robot, origin = T_new_odom @ reading.T_odom_robot, T_new_odom @ reading.T_odom_origin
    return Reading(reading.scan, robot, reading.T_robot_sensor, swept, origin)


def _split_evenly(progress: FloatArray, robots: int, overlap: float) -> list[Segment]:
    if robots < 1:
        raise ValueError(f"robots must be at least 1, got {robots}")
    if not 0.0 <= overlap < 1.0:
        raise ValueError(f"overlap must lie within [0, 1), got {overlap}")
    if len(progress) < 2 * robots:
        raise SegmentationError(f"{len(progress)} readings are too few for {robots} robots")
    length = progress[-1] / (robots - (robots - 1) * overlap)
    segments = []
    for robot in range(robots):
        begin = robot * length * (1.0 - overlap)
        start = int(np.searchsorted(progress, begin, side="left"))
        stop = int(np.searchsorted(progress, begin + length, side="right")) if robot < robots - 1 else len(progress)
        segments.append(Segment(start, max(stop, start + 1)))
    return segments


def _time_steps(stamps: FloatArray) -> FloatArray:
    """Return the times (N - 1,) between readings by stamps (N,) that may step back [s].

    A step back takes no time. A step past the latest stamp takes the time since that stamp; otherwise a single wrong
    stamp would count as a gap.
    """
    if len(stamps) < 2:
        return np.zeros(0)
    before, after = stamps[:-1], stamps[1:]
    latest = np.maximum.accumulate(before)
    return np.asarray(np.maximum(after - np.where(after >= latest, latest, before), 0.0))
