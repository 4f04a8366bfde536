"""Points that a sensor measured in space."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.io.printable import printable

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of a field by their number (sensor_msgs/PointField)."""
_TIMES = ("t", "time", "time_offset", "timestamp", "timeStamp", "point_time_offset")
"""Names that drivers of spinning lidars give the time of a point."""
_NANOSECOND = 1e-9


class PointCloudError(ValueError):
    """A message holds no points in space."""


class PointCloud(NamedTuple):
    """The points of one message.

    Parameters
    ----------
    frame
        The sensor's.
    stamp
        The message's [s]; 0 or less is unset.
    points
        Points (N, 3) in the sensor's frame [m], all finite.
    times
        When each was measured (N,), after the first of them [s]; None if unknown.
    delay
        Time of the first of them after the stamp [s].
    """

    frame: str
    stamp: float
    points: FloatArray
    times: FloatArray | None = None
    delay: float = 0.0


def cloud_of(message: Any) -> PointCloud:
    """Read a sensor_msgs/PointCloud2.

    Raises
    ------
    PointCloudError
        It has no fields x, y and z, or holds fewer bytes than it states.
    """
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
    times, delay = _times(records, finite, stamp)
    return PointCloud(printable(message.header.frame_id), stamp, points[finite], times, delay)


def _times(records: npt.NDArray[Any], finite: npt.NDArray[np.bool_], stamp: float) -> tuple[FloatArray | None, float]:
    """Return when finite points were measured after the first [s], and the first after the stamp [s]."""
    names = [name for name in _TIMES if name in (records.dtype.names or ())]
    if not names or not finite.any():
        return None, 0.0
    stated = records[names[0]][finite]
    unit = _NANOSECOND if stated.dtype.kind in "iu" else 1.0
    first = stated.min()
    times = (stated - first).astype(np.float64) * unit
    if not (np.isfinite(times).all() and 0.0 < times.max() < 1.0):  # no lidar turns more slowly
        return None, 0.0
    delay = float(first) * unit
    if delay > 1.0:  # the driver states times of the day, not times since the stamp
        delay -= stamp
    return times, delay if abs(delay) < 1.0 else 0.0
