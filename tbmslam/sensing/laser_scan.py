"""Measurements of a robot: laser scans, and its pose by odometry."""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray
from tbmslam.kernels.rays.hits import any_negative, hit_points, hits_of_scan

FARTHEST_PLACE = 1e8
"""No robot is farther from anything on earth [m]; beyond, fractions lose digits."""


class Hits(NamedTuple):
    """Points that a laser hit, and how the surfaces there face."""

    points: FloatArray
    """End points (M, 2) [m]."""
    normals: FloatArray
    """Unit normals (M, 2) of the surfaces, towards the laser."""

    def thinned(self, count: int) -> "Hits":
        """Return every n-th hit, n = max(size // count, 1), so that `count` or more remain if there are as many."""
        step = max(len(self.points) // count, 1)
        # Contiguous, since kernels are compiled again for other layouts.
        return Hits(np.ascontiguousarray(self.points[::step]), np.ascontiguousarray(self.normals[::step]))


@dataclass(frozen=True, slots=True)
class LaserScan:
    """One turn of a laser range finder.

    Beam ``i`` points to ``angle_min + i * angle_increment`` in the sensor's frame, counter-clockwise seen from above;
    a clockwise or upside-down laser has a negative increment. The values of ``ranges`` follow REP 117: a finite value
    is a hit, ``+inf`` means that nothing was in range, and ``nan`` means that the beam measured nothing. The readers of
    `datasets` translate the codes of each sensor to these values.
    """

    stamp: float
    """Time of the first beam [s]."""
    angle_min: float
    angle_increment: float
    """Direction of the first beam and step between beams [rad]."""
    range_min: float
    range_max: float
    """Limits between which the sensor can measure [m]."""
    ranges: FloatArray = field(repr=False)
    """Distances (N,) [m], float64."""
    time_increment: float = 0.0
    """Time between two beams [s]; 0 if unknown."""
    beam_step: SE2 = SE2(0.0, 0.0, 0.0)  # noqa: RUF009 - a tuple, which nothing can change
    """Motion of the laser from one beam to the next, as its pose at a beam in its frame at the beam before: beam ``i``
    was sent from ``beam_step`` to the power of ``i``. The identity, if unknown: all beams were sent at one moment."""

    def with_ranges(self, ranges: FloatArray) -> "LaserScan":
        """Return the same scan with other ranges."""
        # dataclasses.replace takes several times as long, and some robots need this for every scan.
        limits = self.angle_min, self.angle_increment, self.range_min, self.range_max
        return LaserScan(self.stamp, *limits, ranges, self.time_increment, self.beam_step)

    def backwards(self) -> "LaserScan":
        """Return the same scan with its beams from the last to the first, as if they were measured in that order."""
        last = self.angle_min + (len(self.ranges) - 1) * self.angle_increment
        return replace(self, angle_min=last, angle_increment=-self.angle_increment, ranges=self.ranges[::-1].copy())

    def sweep(self) -> float:
        """Return the time from the first beam to the last [s]; 0 if unknown."""
        return self.time_increment * max(len(self.ranges) - 1, 0)

    def is_hit(self) -> BoolArray:
        """Return which beams (N,) ended on something."""
        return np.isfinite(self.ranges)

    def hit_points(self, max_range: float = math.inf) -> FloatArray:
        """Return the end points (M, 2) of the beams that hit something within a range, in the sensor's frame [m].

        The frame is that of the first beam, at the scan's stamp.
        """
        return hit_points(self.ranges, self.angle_min, self.angle_increment, self.beam_step, max_range)

    def hits(self, max_range: float = math.inf) -> Hits:
        """Return the hits within a range and the normals of the surfaces, in the sensor's frame.

        A normal is square to the line between the neighbours on both sides; where those lie on something else, beyond
        half a metre, the surface is taken to face the laser.
        """
        # Kernels accept plain tuples in half the time of named tuples, and this is called for every scan.
        step = (*self.beam_step,)
        return Hits(*hits_of_scan(self.ranges, self.angle_min, self.angle_increment, step, max_range))


@dataclass(frozen=True, slots=True)
class Reading:
    """A scan and the odometry at its stamp."""

    scan: LaserScan
    T_odom_robot: SE2 | None
    """Pose of the robot in its odometry frame at the scan's stamp; None if there is no odometry."""
    T_robot_sensor: SE2 = field(default_factory=SE2.identity)
    """Pose of the laser on the robot, projected to the plane (an upside-down laser shows in the scan's increment)."""
    T_odom_swept: SE2 | None = None
    """Pose of the robot in its odometry frame at the scan's last beam; None if unknown."""
    T_odom_origin: SE2 = SE2.identity()  # noqa: RUF009  # immutable
    """Pose at which the odometry began, in its frame; another frame moves it."""

    def check(self) -> None:
        """Refuse impossible numbers, from which compiled code would compute memory addresses.

        Raises
        ------
        ValueError
            A pose is not finite or beyond `FARTHEST_PLACE`, a number of the scan is not finite (range_max may be
            infinite), all of its beams have one direction, or a range is negative.
        """
        _check_pose("T_odom_robot", self.T_odom_robot)
        _check_pose("T_robot_sensor", self.T_robot_sensor)
        _check_pose("T_odom_swept", self.T_odom_swept)
        scan = self.scan
        _check_pose("beam_step", scan.beam_step)
        numbers = scan.stamp, scan.angle_min, scan.angle_increment, scan.range_min, scan.time_increment
        if not math.isfinite(sum(numbers)):
            raise ValueError(
                "stamp, angle_min, angle_increment, range_min and time_increment must be finite, got "
                f"{', '.join(map(str, numbers))}"
            )
        if math.isnan(scan.range_max):
            raise ValueError("range_max must be a number, got nan: inf means unlimited")
        if scan.angle_increment == 0.0 and len(scan.ranges) > 1:
            raise ValueError(
                f"angle_increment must not be 0 with more than one beam, got 0 and {len(scan.ranges)} beams"
            )
        # Also -inf, which some drivers write for objects that are too close.
        if any_negative(scan.ranges):
            raise ValueError(
                f"ranges must not be negative, got {np.nanmin(scan.ranges)}: nan means unknown, inf means no return"
            )

    def with_scan(self, scan: LaserScan) -> "Reading":
        """Return the same reading with another scan."""
        return Reading(scan, self.T_odom_robot, self.T_robot_sensor, self.T_odom_swept, self.T_odom_origin)


def _check_pose(name: str, pose: SE2 | None) -> None:
    # Negated, because every comparison with NaN is false.
    if pose is not None and not abs(pose[0]) + abs(pose[1]) + abs(pose[2]) <= FARTHEST_PLACE:
        raise ValueError(f"{name} must be finite and within {FARTHEST_PLACE:.0e} m, got {pose}")


class Corrections(NamedTuple):
    """The corrections that the user applied, so that a warning can name better ones."""

    range_offset: float = 0.0
    """Added to every range that was measured [m]."""
    odometry_scale: float = 1.0
    """Factor by which the lengths of the odometry were multiplied."""
    angle_step: bool = False
    """Whether the user stated the angle between beams."""
    clock_offset: float = 0.0
    """Added to the stamp of each scan before odometry was looked up, also if it was detected [s]."""
