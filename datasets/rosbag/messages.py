"""The ROS messages that are read: their definitions, and their bytes decoded to the types of this project."""

import logging
import struct
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from datasets.clouds import PointCloud, PointCloudError, cloud_of
from datasets.odometry.se3 import SE3
from datasets.scans.intake import RawScan
from tbmslam.errors import printable

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ECHOES_TYPE = "sensor_msgs/msg/MultiEchoLaserScan"
CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
POSE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"

_MD5_SUMS = {
    SCAN_TYPE: "90c7ef2dc6895d81024acba2ac42f369",
    ODOMETRY_TYPE: "cd5e73d190d741a2f92e81eda573aca7",
    **dict.fromkeys(TF_TYPES, "94810edda583a504dfda3829e70d7eec"),
}
"""Checksums of the usual definitions of ROS 1; loading all definitions takes longer than reading a small bag."""


@cache
def standard_types(is_ros1: bool) -> "Typestore":
    """Return the standard message definitions, with both names of the tf message.

    They are the same ones each time, as rosbags makes the code that decodes a type when it is first used.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - mostly not needed

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in TF_TYPES:
        if name not in store.fielddefs:
            store.register(get_types_from_msg(_TF_DEFINITION, name))
    return store


def standard_md5_sum(msgtype: str) -> str | None:
    """Return the checksum of a type's standard definition in ROS 1; None if there is none."""
    if msgtype in _MD5_SUMS:
        return _MD5_SUMS[msgtype]
    store = standard_types(is_ros1=True)
    return store.generate_msgdef(msgtype)[1] if msgtype in store.fielddefs else None


class StampedTransform(NamedTuple):
    """One edge of tf at a time; `pose` transforms from child to parent; a stamp of 0 or less is unset."""

    parent: str
    child: str
    stamp: float
    pose: SE3

    def stamp_or(self, unset: float) -> float:
        """Return the stamp [s], or the given one if it is unset."""
        return self.stamp if self.stamp > 0.0 else unset


class FramedScan(NamedTuple):
    """A scan and the frame of the laser that made it; a stamp of 0 or less is unset."""

    frame: str
    scan: RawScan

    def stamped(self, unset: float) -> RawScan:
        """Return the scan, with the given stamp [s] if its own is unset."""
        return self.scan if self.scan.stamp > 0.0 else self.scan._replace(stamp=unset)


def scan_of(message: Any) -> FramedScan:
    """Read a LaserScan, or of a MultiEchoLaserScan the first echoes, nan if a beam has none."""
    ranges = message.ranges
    if not isinstance(ranges, np.ndarray):
        first = [beam.echoes[0] if len(beam.echoes) else np.nan for beam in ranges]
        ranges = np.array(first, dtype=np.float32)
    scan = RawScan(
        stamp_of(message.header),
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_min),
        float(message.range_max),
        ranges,
        float(message.time_increment),
    )
    return FramedScan(printable(message.header.frame_id), scan)


def transforms_of(message: Any) -> Iterator[StampedTransform]:
    """Read a TFMessage, without invalid poses."""
    for item in message.transforms:
        t, q = item.transform.translation, item.transform.rotation
        pose = SE3.from_values(t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        if pose is not None:
            parent, child = printable(item.header.frame_id), printable(item.child_frame_id)
            yield StampedTransform(parent, child, stamp_of(item.header), pose)


def poses_of(message: Any) -> Iterator[StampedTransform]:
    """Read the pose of an Odometry or PoseWithCovarianceStamped; none if it is no motion."""
    p, q = message.pose.pose.position, message.pose.pose.orientation
    pose = SE3.from_values(p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    if pose is not None:
        child = printable(getattr(message, "child_frame_id", ""))
        yield StampedTransform(printable(message.header.frame_id), child, stamp_of(message.header), pose)


def stamp_of(header: Any) -> float:
    """Return a header's stamp [s]."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


logger = logging.getLogger(__name__)

Content: TypeAlias = FramedScan | list[StampedTransform]

_LITTLE_ENDIAN = b"\x00\x01"
_PADDING = 3  # bytes at the end of a message that CDR may add
_SIZE = struct.Struct("<I")
_STAMP = struct.Struct("<iI")
_POSE = struct.Struct("<7d")
_BEHIND_POSE = 8 * (36 + 6 + 36)  # bytes of an Odometry's covariance, twist and covariance of the twist


class NotAsUsualError(ValueError):
    """The bytes of a message are not as usual: only a library may be able to read them."""


def reader_of(msgtype: str, *, is_cdr: bool) -> Callable[[bytes], Content] | None:
    """Return a reader of messages of a type, in the format of ROS 2 if `is_cdr`; None if only a library reads them.

    The reader raises a ValueError (`NotAsUsualError`) or struct.error if the bytes have an unusual layout.
    """
    readers: dict[str, Callable[[bytes, bool], Content]] = {SCAN_TYPE: _scan, ODOMETRY_TYPE: _odometry}
    readers |= dict.fromkeys(TF_TYPES, _transforms)
    read = readers.get(msgtype)
    if read is None:
        return None
    return _checked_cdr(read) if is_cdr else lambda data: read(data, False)


def _checked_cdr(read: Callable[[bytes, bool], Content]) -> Callable[[bytes], Content]:
    """Return a reader of ROS 2 messages that are little-endian."""

    def read_checked(data: bytes) -> Content:
        if bytes(data[:2]) != _LITTLE_ENDIAN:
            raise NotAsUsualError("not little-endian")
        return read(data, True)

    return read_checked


def _scan(data: bytes, is_cdr: bool) -> FramedScan:
    """Read a LaserScan."""
    (size,) = _SIZE.unpack_from(data, 12)
    if size > len(data):
        raise NotAsUsualError(f"a name of {size} bytes")
    layout = _scan_layout(size, is_cdr)
    values = layout.unpack_from(data, 4)
    seconds, nanoseconds, _, frame, angle_min, _, angle_step, time_step, _, range_min, range_max, beams = values
    start = 4 + layout.size
    (intensities,) = _SIZE.unpack_from(data, start + 4 * beams)
    _check_end(data, start + 4 * beams + 4 + 4 * intensities, is_cdr)
    ranges = np.frombuffer(data, np.float32, beams, start)
    scan = RawScan(seconds + 1e-9 * nanoseconds, angle_min, angle_step, range_min, range_max, ranges, time_step)
    return FramedScan(_text(frame, is_cdr), scan)


@lru_cache(64)
def _scan_layout(size: int, is_cdr: bool) -> struct.Struct:
    """Return the fields of a LaserScan up to the number of its ranges, for a frame's name of a size [bytes]."""
    padding = -size % 4 if is_cdr else 0
    return struct.Struct(f"<iII{size}s{padding}x7fI")


def _transforms(data: bytes, is_cdr: bool) -> list[StampedTransform]:
    """Read a TFMessage, without invalid poses."""
    place = 4 if is_cdr else 0
    (number,) = _SIZE.unpack_from(data, place)
    place += 4
    transforms = []
    for _ in range(number):
        parent, child, stamp, place = _frames(data, (place + 3) & -4 if is_cdr else place + 4, is_cdr)
        pose = SE3.from_values(*_POSE.unpack_from(data, place))
        place += _POSE.size
        if pose is not None:
            transforms.append(StampedTransform(parent, child, stamp, pose))
    _check_end(data, place, is_cdr)
    return transforms


def _odometry(data: bytes, is_cdr: bool) -> list[StampedTransform]:
    """Read the pose of an Odometry; none if it is no motion."""
    parent, child, stamp, place = _frames(data, 4, is_cdr)
    pose = SE3.from_values(*_POSE.unpack_from(data, place))
    _check_end(data, place + _POSE.size + _BEHIND_POSE, is_cdr)
    return [StampedTransform(parent, child, stamp, pose)] if pose is not None else []


def _frames(data: bytes, place: int, is_cdr: bool) -> tuple[str, str, float, int]:
    """Read a stamp and two frames; return parent, child, stamp [s], and the position of the following numbers."""
    seconds, nanoseconds = _STAMP.unpack_from(data, place)
    place += _STAMP.size
    (size,) = _SIZE.unpack_from(data, place)
    end = place + 4 + size
    parent = data[place + 4 : end]
    place = (end + 3) & -4 if is_cdr else end
    (size,) = _SIZE.unpack_from(data, place)
    end = place + 4 + size
    child = data[place + 4 : end]
    if is_cdr:  # counted from the end of the first four bytes
        end = ((end + 3) & -8) + 4
    return _text(parent, is_cdr), _text(child, is_cdr), seconds + 1e-9 * nanoseconds, end


def _check_end(data: bytes, end: int, is_cdr: bool) -> None:
    """Refuse bytes that are longer or shorter than the message."""
    if not 0 <= len(data) - end <= (_PADDING if is_cdr else 0):
        raise NotAsUsualError(f"{len(data)} bytes, and its fields end at {end}")


@lru_cache(1024)
def _text(data: bytes, is_cdr: bool) -> str:
    """Return the text of a string's bytes, with control characters escaped."""
    if not is_cdr:
        return printable(data.decode())
    if data[-1:] != b"\0":
        raise NotAsUsualError("a string without a zero at its end")
    return printable(data[:-1].decode())


class MessageDecoder:
    """Decodes messages of ROS 1 or ROS 2 by the standard definitions of their types."""

    def __init__(self, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self._readers = {name: reader_of(name, is_cdr=not is_ros1) for name in (SCAN_TYPE, *TF_TYPES)}

    def decoded(self, msgtype: str, data: bytes) -> Content | PointCloud | None:
        """Return the content of a message; None if its bytes cannot be decoded."""
        if msgtype not in self._readers:
            self._readers[msgtype] = reader_of(msgtype, is_cdr=not self._is_ros1)
        read = self._readers[msgtype]
        if read is not None:
            try:
                return read(data)
            except Exception as error:  # noqa: BLE001 - a damaged database may even hold what are no bytes
                logger.debug("a %s is not laid out as usual: %r", msgtype, error)
        return self._by_rosbags(msgtype, data)

    def whole(self, msgtype: str, data: bytes) -> Any:
        """Return a message with all of its fields, as rosbags decodes it; None if its bytes cannot be decoded."""
        try:
            store = standard_types(self._is_ros1)
            return (store.deserialize_ros1 if self._is_ros1 else store.deserialize_cdr)(data, msgtype)
        except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged bytes
            logger.debug("a %s cannot be decoded: %r", msgtype, error)
            return None

    def _by_rosbags(self, msgtype: str, data: bytes) -> Content | PointCloud | None:
        """Return the same by rosbags, for any type and byte order."""
        message = self.whole(msgtype, data)
        if message is None:
            return None
        if msgtype in (SCAN_TYPE, ECHOES_TYPE):
            return scan_of(message)
        if msgtype == CLOUD_TYPE:
            return _cloud(message)
        return list(transforms_of(message) if msgtype in TF_TYPES else poses_of(message))


def _cloud(message: Any) -> PointCloud | None:
    """Return the points of a message; None if it holds none in space."""
    try:
        return cloud_of(message)
    except PointCloudError as error:
        logger.debug("a point cloud cannot be read: %s", error)
        return None
