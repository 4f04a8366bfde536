"""Point clouds, cut between two heights into scans.

The points of a message are transformed to the robot's frame and cut between two heights. The nearest wall of each
direction becomes a beam. The heights and the beams are chosen by the first clouds of a recording, unless options state
them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from datasets.scans.intake import RawScan
from tbmslam.errors import printable
from tbmslam.geometry.se2 import SE2, FloatArray

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of a field by their number (sensor_msgs/PointField)."""
_TIMES = ("t", "time", "time_offset", "timestamp", "timeStamp", "point_time_offset")
"""Names that drivers of spinning lidars give the time of a point."""
_NANOSECOND = 1e-9
_UNITS = (1.0, 1e-3, 1e-6, _NANOSECOND)  # possible units of these times [s]
_SHORTEST_SWEEP, _LONGEST_SWEEP = 0.02, 1.0  # limits of the duration of a cloud [s]: no lidar turns more slowly
_FEWEST_TIMES = 100
"""Points that must state a time before their duration decides on its unit; few points may be a part of a sweep."""


class PointCloudError(ValueError):
    """A message holds no points in space."""


class PointCloud(NamedTuple):
    """The points of one message."""

    frame: str
    stamp: float
    """Stamp of the message [s]; 0 or less is unset."""
    points: FloatArray
    """Points (N, 3) in the sensor's frame [m], all finite."""
    times: FloatArray | None = None
    """Times of measurement (N,) since the first point [s]; None if unknown."""
    delay: float = 0.0
    """Time of the first point after the stamp [s]."""
    unused_times: str | None = None
    """Field of the points' times and their duration in its unit, if this is no duration of a sweep."""


class PointTimes(NamedTuple):
    """Times of the points of one message, as in `PointCloud`."""

    times: FloatArray | None = None
    delay: float = 0.0
    unused: str | None = None


def cloud_of(message: Any) -> PointCloud:
    """Read a sensor_msgs/PointCloud2; raise a `PointCloudError` if it lacks x, y and z, or bytes that it states."""
    order = ">" if message.is_bigendian else "<"
    fields = {
        field.name: (order + _KINDS[field.datatype], field.offset)
        for field in message.fields
        if field.datatype in _KINDS and field.count in (0, 1)
    }
    if not {"x", "y", "z"} <= fields.keys():
        raise PointCloudError(f"fields x, y and z are missing, there are {', '.join(fields) or 'none'}")
    try:
        dtype = np.dtype(
            {
                "names": list(fields),
                "formats": [kind for kind, _ in fields.values()],
                "offsets": [offset for _, offset in fields.values()],
                "itemsize": message.point_step,
            }
        )
    except ValueError as error:
        raise PointCloudError(f"its fields do not fit into {message.point_step} bytes: {error}") from error
    rows, cols = message.height, message.width
    data = np.frombuffer(message.data, np.uint8)
    if message.row_step * rows > len(data) or message.point_step * cols > message.row_step or not message.point_step:
        raise PointCloudError(f"{rows} rows of {cols} points take more than its {len(data)} bytes")
    lines = data[: message.row_step * rows].reshape(rows, message.row_step)[:, : message.point_step * cols]
    records = np.ascontiguousarray(lines).view(dtype).reshape(-1)
    points = np.column_stack([records[axis].astype(np.float64) for axis in "xyz"])
    finite = np.asarray(np.isfinite(points).all(axis=1))
    stamp = float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
    return PointCloud(printable(message.header.frame_id), stamp, points[finite], *_times(records, finite, stamp))


def _times(records: npt.NDArray[Any], finite: npt.NDArray[np.bool_], stamp: float) -> PointTimes:
    """Return the times of the finite points.

    Their unit is the usual one of their type unless only another fits the duration of a sweep: the units differ by
    1000.
    """
    names = [name for name in _TIMES if name in (records.dtype.names or ())]
    if not names or not finite.any():
        return PointTimes()
    stated = records[names[0]][finite]
    first = stated.min()
    since = (stated - first).astype(np.float64)
    longest = float(since.max())
    if longest == 0.0:  # the driver leaves them out, or all points are measured at once
        return PointTimes()
    unit = _NANOSECOND if stated.dtype.kind in "iu" else 1.0
    fitting = [other for other in _UNITS if _SHORTEST_SWEEP <= longest * other < _LONGEST_SWEEP]
    if fitting and unit not in fitting and len(stated) >= _FEWEST_TIMES:
        unit = fitting[0]
    if not longest * unit < _LONGEST_SWEEP:  # or not a number
        return PointTimes(unused=f"{names[0]}, {longest:.6g} from first to last")
    delay = float(first) * unit
    if delay > 1.0:  # the driver states times of the day, not times since the stamp
        delay -= stamp
    return PointTimes(since * unit, delay if abs(delay) < 1.0 else 0.0)


_TIE = 1e-6
"""Share of a beam by which directions are shifted, so that rounding does not decide between two equally near beams."""
_WALL_DEPTH = 0.15
"""Points of one direction within this distance behind the nearest [m] lie on the same wall: ranges are noisy."""
_WIDEST_GAP, _BESIDE = 2.0, 0.6
"""Largest gap between points of one wall, and largest distance of a point from its beam, in beams: directions vary."""
_NEAREST, _FARTHEST = 0.1, 300.0  # limits of a range [m]; a cloud states none


@dataclass(frozen=True)
class CloudSlice:
    """The slice of point clouds that becomes scans."""

    T_robot_sensor: SE3
    """Mount of the sensor. If only its pose in the plane is known, heights are above the sensor."""
    low: float
    high: float
    """Lowest and highest point of the slice above the robot's frame [m]."""
    opening: float = 0.0
    """Rise of the upper bound with the range [m/m]."""
    angle_min: float = -math.pi
    angle_step: float = math.radians(1.0)
    """Direction of the first beam and angle to the next, at the sensor and relative to the robot's axes [rad]."""
    beams: int = 360
    time_step: float = 0.0
    """Time between two beams [s]; 0 if unknown or if all are measured at once."""

    @property
    def T_robot_scan(self) -> SE2:
        """Pose of the scans: at the sensor, along the robot's axes."""
        return SE2(self.T_robot_sensor.x, self.T_robot_sensor.y, 0.0)

    def scan(self, cloud: PointCloud) -> RawScan:
        """Return the scan of a cloud's slice: for each direction the range of the nearest wall, or nan."""
        points, times = self.points(cloud)
        angles = np.arctan2(points[:, 1], points[:, 0])
        ranges = np.hypot(points[:, 0], points[:, 1])
        turned = (angles - self.angle_min) / self.angle_step % (2.0 * math.pi / abs(self.angle_step))
        found = _nearest_walls(turned, ranges, self.beams)
        stamp = cloud.stamp
        if times is not None and len(times) and self.time_step > 0.0 and stamp > 0.0:
            stamp += cloud.delay + float(np.median(times - turned * self.time_step))
        return RawScan(
            stamp, self.angle_min, self.angle_step, _NEAREST, _FARTHEST, found.astype(np.float32), self.time_step
        )

    def points(self, cloud: PointCloud) -> tuple[FloatArray, FloatArray | None]:
        """Return the slice's points (N, 2), seen from the sensor along the robot's axes, and their times (N,)."""
        turned = rotation_of(self.T_robot_sensor) @ cloud.points.T
        heights = turned[2] + self.T_robot_sensor.z
        ranges = np.hypot(turned[0], turned[1])
        high = self.high + self.opening * ranges
        inside = (heights >= self.low) & (heights <= high) & (ranges > _NEAREST) & (ranges < _FARTHEST)
        return turned[:2, inside].T, None if cloud.times is None else cloud.times[inside]


def rotation_of(pose: SE3) -> FloatArray:
    """Return the rotation matrix (3, 3) of a motion."""
    return np.column_stack([pose.rotated(*axis) for axis in np.eye(3).tolist()])


def _nearest_walls(turned: FloatArray, ranges: FloatArray, beams: int) -> FloatArray:
    """Return the range (beams,) of the nearest wall at the middle of each beam; nan if there is none.

    `turned` (N,) are the directions of the points as multiples of the angle between beams, from the first beam, and
    `ranges` (N,) their ranges [m]. Within the width of a beam the points of the nearest wall are averaged. Between two
    averages of one wall the wall is straight: the inverse of its range is linear in the direction over so small an
    angle.
    """
    if not len(ranges):
        return np.full(beams, np.nan)
    beam = np.rint(turned + _TIE).astype(np.int64)
    offset = turned - beam
    beam %= beams
    nearest = np.full(beams, np.inf)
    np.minimum.at(nearest, beam, ranges)
    on_wall = ranges <= nearest[beam] + _WALL_DEPTH
    beam, offset, ranges = beam[on_wall], offset[on_wall], ranges[on_wall]
    counts = np.bincount(beam, minlength=beams)
    filled = np.flatnonzero(counts)
    mean = np.bincount(beam, ranges, beams)[filled] / counts[filled]
    place = filled + np.bincount(beam, offset, beams)[filled] / counts[filled]
    mean = np.concatenate((mean[-1:], mean, mean[:1]))
    place = np.concatenate((place[-1:] - beams, place, place[:1] + beams))
    middle = np.arange(beams)
    right = np.clip(np.searchsorted(place, middle), 1, len(place) - 1)
    left = right - 1
    gap, from_left = place[right] - place[left], middle - place[left]
    share = np.divide(from_left, gap, out=np.zeros(beams), where=gap > 0.0)
    between = 1.0 / ((1.0 - share) / mean[left] + share / mean[right])
    one_wall = (gap <= _WIDEST_GAP) & (np.abs(mean[right] - mean[left]) <= _WALL_DEPTH)
    alone = np.where(share <= 0.5, mean[left], mean[right])
    is_near = np.minimum(np.abs(from_left), np.abs(place[right] - middle)) <= _BESIDE
    return np.where(one_wall, between, np.where(is_near, alone, np.nan))


_HALF_HEIGHT = 0.25
"""Default extent of the slice above and below the sensor [m]; it contains two to four of 16 rings."""
_OPENING = math.tan(math.radians(1.0))
"""Default rise of the slice's upper bound: of 16 rings, the one that rises by 1 degree meets every wall inside it.

The lower bound does not fall: falling rings meet the floor.
"""
_FLOOR = 0.1  # height above the robot's frame below which points count as floor if no heights are stated [m]
_FEWEST_DIRECTIONS = 0.05
"""Share of the directions in which a slice must hold points; a camera covers an eighth of a turn."""
_STEPS_DEG = (0.2, 0.25, 0.4, 0.5, 1.0)  # possible angles between beams [degrees]: those of spinning lidars
_FILLED = 0.9
"""Share of the directions with points, in steps of a degree, that must also hold points in the chosen steps."""
_STEADY = 0.8
"""Share of the points whose times must fit a steady rotation, within the larger of the next two tolerances."""
_LATE_S, _LATE_TURN = 1e-3, 0.02  # tolerances: a time [s], and a share of a turn
_LEAST_TURN, _MOST_TURN = math.pi / 2.0, 2.2 * math.pi  # rotation of the sensor during one cloud [rad]


class _Axes(NamedTuple):
    """The directions of a frame's axes at a level sensor."""

    level: SE3
    """Rotation of the frame."""
    rolled: SE3
    """Half a turn around the axis along which the sensor looks."""
    up: tuple[float, float, float]
    """Axis that points upwards."""


_USUAL = _Axes(SE3.identity(), SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
_OPTICAL = _Axes(SE3(0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5), SE3(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
"""Axes of a camera's optical frame: z ahead, x to the right, y down (REP 103 of ROS)."""


def is_optical(frame: str) -> bool:
    """Return whether a frame is a camera's optical frame by the convention of ROS, as in camera_optical_frame."""
    return "optical" in frame.rsplit("/", 1)[-1].lower()


def mounting(T_robot_sensor: SE3 | None, sensor_pose: SE2 | None, upside_down: bool | None, frame: str = "") -> SE3:
    """Return the mount of a sensor in space from its mount in tf, None if unknown.

    `sensor_pose` replaces the pose in the plane, but not the height and the tilt. Without a mount in tf the sensor is
    level. A camera, by the name of its frame, looks in the direction of `sensor_pose`. `upside_down` states which side
    is up, regardless of tf: another side is turned up around the axis along which the sensor looks.
    """
    axes = _OPTICAL if is_optical(frame) else _USUAL
    T_robot_plane = SE3.from_planar(sensor_pose or SE2.identity())
    if T_robot_sensor is None:
        T_robot_sensor = T_robot_plane @ axes.level
    elif sensor_pose is not None:
        looking = (T_robot_sensor @ axes.level.inverse()).planar()
        T_robot_sensor = T_robot_plane @ SE3.from_planar(looking).inverse() @ T_robot_sensor
    hangs = T_robot_sensor.rotated(*axes.up)[2] < 0.0
    return T_robot_sensor if upside_down in (None, hangs) else T_robot_sensor @ axes.rolled


def choose_slice(
    T_robot_sensor: SE3,
    heights: tuple[float, float] | None,
    step_deg: float | None,
    clouds: Sequence[PointCloud],
    named: str,
    unknown: str | None = None,
) -> CloudSlice:
    """Choose heights and beams for the clouds of a recording; raise a `DatasetError` if the slice is nearly empty.

    `heights` are the lowest and the highest point above the robot's frame [m]; None chooses a band around the sensor
    without floor, which opens upwards with the range. `step_deg` is the angle between beams, of any sign; None chooses
    the finest angle whose beams have points. `clouds` are the first clouds of the recording. Errors begin with `named`,
    the file and the topic of the clouds. `unknown` is the sensor's frame if its mount is unknown.
    """
    low, high = heights or (T_robot_sensor.z - _HALF_HEIGHT, T_robot_sensor.z + _HALF_HEIGHT)
    if heights is None and T_robot_sensor.z > _FLOOR:
        low = max(low, _FLOOR)
    cut = CloudSlice(T_robot_sensor, low, high, 0.0 if heights else _OPENING)
    _check_walls(cut, clouds, named, unknown)
    step = math.radians(abs(step_deg or _finest_step(cut, clouds)))
    cut = replace(cut, angle_step=step, beams=round(2.0 * math.pi / step))
    turns = [turn for cloud in clouds if (turn := _turn(cut, cloud)) is not None]
    if 2 * len(turns) <= len(clouds):
        return cut
    rate = float(np.median([rate for rate, _ in turns]))
    start = float(np.angle(np.exp([1j * first for _, first in turns]).mean()))
    return replace(cut, angle_min=start, angle_step=math.copysign(step, rate), time_step=step / abs(rate))


def times_warning(clouds: Sequence[PointCloud]) -> str | None:
    """Return a warning if most clouds state times of their points that cannot be used, else None."""
    unused = [cloud.unused_times for cloud in clouds if cloud.unused_times is not None]
    if 2 * len(unused) <= len(clouds):
        return None
    return (
        f"the times of the points (field {unused[0]}) last as long as no sweep of a lidar in s, ms, us or ns: they are "
        "ignored, so the motion during a cloud is not compensated: record them in seconds or nanoseconds"
    )


def _check_walls(cut: CloudSlice, clouds: Sequence[PointCloud], named: str, unknown: str | None) -> None:
    shares = [float(np.isfinite(cut.scan(cloud).ranges).mean()) for cloud in clouds]
    if np.median(shares) >= _FEWEST_DIRECTIONS:
        return
    turned = np.concatenate([cloud.points for cloud in clouds]) @ rotation_of(cut.T_robot_sensor).T
    heights = turned[:, 2] + cut.T_robot_sensor.z
    where = "are empty"
    if len(heights):
        lowest, highest = np.percentile(heights, (5.0, 95.0))
        degrees = np.unique(np.floor(np.degrees(np.arctan2(turned[:, 1], turned[:, 0]))))
        if cut.low <= lowest and highest <= cut.high and len(degrees) < 360.0 * _FEWEST_DIRECTIONS:
            raise DatasetError(
                f"{named} lie at the right heights, but in {len(degrees)} of 360 degrees around the origin of their "
                "frame: choose a topic with points in the sensor's own frame, with --scan-topic"
            )
        where = f"lie mostly between {lowest:.2f} and {highest:.2f} m"
    if unknown is not None:
        raise DatasetError(
            f"{named} hold hardly any point between {cut.low:.2f} and {cut.high:.2f} m above the sensor, if it is "
            f"level: tf lacks the mount of its frame {unknown}. They {where}: record tf and tf_static with the mount; "
            "if the sensor is level, choose heights at which there are walls with --cloud-heights"
        )
    raise DatasetError(
        f"{named} hold hardly any point between {cut.low:.2f} and {cut.high:.2f} m above the robot's "
        f"frame; they {where}: choose heights at which there are walls with --cloud-heights"
    )


def _finest_step(cut: CloudSlice, clouds: Sequence[PointCloud]) -> float:
    """Return the finest angle between beams at which nearly all have points [degrees]."""
    filled: dict[float, list[float]] = {step: [] for step in _STEPS_DEG}
    for cloud in clouds:
        points, _ = cut.points(cloud)
        if not len(points):
            continue
        angles = np.degrees(np.arctan2(points[:, 1], points[:, 0])) + 180.0
        degrees = len(np.unique(np.floor(angles)))
        for step, shares in filled.items():
            shares.append(len(np.unique(np.floor(angles / step))) * step / degrees)
    return next((step for step, shares in filled.items() if shares and np.median(shares) >= _FILLED), _STEPS_DEG[-1])


def _turn(cut: CloudSlice, cloud: PointCloud) -> tuple[float, float] | None:
    """Return the rotation rate of a sensor [rad/s] and its initial direction [rad]; None if it does not rotate."""
    points, times = cut.points(cloud)
    if times is None or len(times) < cut.beams // 4:
        return None
    order = np.argsort(times, kind="stable")
    times, angles = times[order], np.arctan2(points[order, 1], points[order, 0])
    total, lasts = float(np.angle(np.exp(1j * np.diff(angles))).sum()), float(times[-1] - times[0])
    if not (lasts > 0.0 and _LEAST_TURN < abs(total) < _MOST_TURN):
        return None
    rate = total / lasts
    starts = np.exp(1j * (angles - rate * times))
    start = float(np.angle(np.median(starts.real) + 1j * np.median(starts.imag)))
    late_s = np.abs(np.angle(starts * np.exp(-1j * start))) / abs(rate)
    allowed_s = max(_LATE_S, _LATE_TURN * 2.0 * math.pi / abs(rate))
    return (rate, start) if float((late_s <= allowed_s).mean()) >= _STEADY else None
