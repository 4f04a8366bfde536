"""A map as a message in a bag, as a map server or SLAM publishes it."""

import os
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer

from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from datasets.rosbag.messages import standard_types
from datasets.rosbag.source import BagSource
from tbmslam.belief.grid import GridGeometry, TbmGrid, masses_from_occupancy, occupancy_of
from tbmslam.io.atomic_file import replacing
from tbmslam.io.ros_map import grid_at
from tbmslam.map.map_check import MapFileError, check_geometry

Format = Literal["ros1", "mcap"]

TOPIC, FRAME = "/map", "map"
_TYPE = "nav_msgs/msg/OccupancyGrid"

_FOREVER = QosTime(9223372036, 854775807)  # an unlimited time in ROS 2 (`RMW_DURATION_INFINITE`)
LATCHED = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_FOREVER,
    lifespan=_FOREVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_FOREVER,
    avoid_ros_namespace_conventions=False,
)
"""The quality of service of nav2's map server and of fixed transforms: nodes that subscribe later receive them too."""


def write_occupancy_bag(path: str | os.PathLike[str], grid: TbmGrid, stamp: float, kind: Format = "ros1") -> None:
    """Write one nav_msgs/OccupancyGrid with a stamp [s] on /map in frame map, whole or not at all.

    Its values are those that map_server publishes for the map.yaml of the same grid: 0 free, 100 occupied, -1 unknown.
    With `mcap` the path is the mcap file of ROS 2 itself, without a folder around it.
    """
    if kind not in {"ros1", "mcap"}:
        raise ValueError(f"kind must be ros1 or mcap, got {kind!r}")
    nanoseconds = max(round(stamp * 1e6) * 1000, 1)  # a bag's times are positive
    with replacing(path) as temporary, tempfile.TemporaryDirectory(dir=temporary.parent, prefix=".") as folder:
        _write(Path(folder) / "map", grid, nanoseconds, kind).replace(temporary)


def _write(place: Path, grid: TbmGrid, nanoseconds: int, kind: Format) -> Path:
    """Write the bag and return the file."""
    store = standard_types(kind == "ros1")
    message = _message(store, grid, nanoseconds, {"seq": 0} if kind == "ros1" else {})
    if kind == "ros1":
        with Rosbag1Writer(place) as writer:
            connection = writer.add_connection(TOPIC, _TYPE, typestore=store, latching=1)
            writer.write(connection, nanoseconds, bytes(store.serialize_ros1(message, _TYPE)))
        return place
    with Rosbag2Writer(place, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection(TOPIC, _TYPE, typestore=store, offered_qos_profiles=(LATCHED,))
        bag.write(connection, nanoseconds, store.serialize_cdr(message, _TYPE))
    return next(place.glob("*.mcap"))


def _message(store: Any, grid: TbmGrid, nanoseconds: int, sequence: dict[str, int]) -> object:
    def make(name: str, **fields: object) -> Any:
        return store.types[name](**fields)

    stamp = make("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    geometry = grid.geometry
    origin = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=geometry.origin_x, y=geometry.origin_y, z=0.0),
        orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return make(
        _TYPE,
        header=make("std_msgs/msg/Header", stamp=stamp, frame_id=FRAME, **sequence),
        info=make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=stamp,
            resolution=geometry.resolution,
            width=geometry.cols,
            height=geometry.rows,
            origin=origin,
        ),
        data=occupancy_of(grid).ravel(),
    )


def read_occupancy_bag(path: Path) -> TbmGrid:
    """Read the last nav_msgs/OccupancyGrid of a bag; a turned one is resampled to lie along the axes."""
    source = BagSource(path)
    topics = {
        connection.topic: connection.msgcount
        for connection in source.connections
        if connection.msgtype == _TYPE and connection.msgcount
    }
    if len(topics) != 1:
        raise DatasetError(f"{path}: holds {', '.join(topics) or 'no'} OccupancyGrid topics: it must hold exactly one")
    (topic,) = topics
    data, is_ros1 = b"", source.is_ros1
    for message in source.messages([topic], topic):
        data, is_ros1 = message.data, message.connection.is_ros1
    source.close()
    store = standard_types(is_ros1)
    try:
        content = (store.deserialize_ros1 if is_ros1 else store.deserialize_cdr)(data, _TYPE)
    except Exception as error:  # rosbags raises anything on damaged bytes
        raise DatasetError(f"{path}: the map on {topic} cannot be decoded: record it again") from error
    return _grid(path, content)


def _grid(path: Path, message: Any) -> TbmGrid:
    info, cells = message.info, np.asarray(message.data, dtype=np.int8)
    place, turn = info.origin.position, info.origin.orientation
    origin = SE3.from_values(place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
    if origin is None:
        raise MapFileError(f"{path}: the origin of the map is no valid pose: record it again")
    corner = origin.planar()
    resolution = float(str(np.float32(info.resolution)))  # 0.05 and not 0.0500000007: the message states a float32
    geometry = GridGeometry(resolution, corner.x, corner.y, int(info.height), int(info.width))
    check_geometry(path, geometry)
    if len(cells) != geometry.rows * geometry.cols:
        raise MapFileError(f"{path}: {len(cells)} cells are not {geometry.rows} x {geometry.cols}: record it again")
    masses = masses_from_occupancy(np.clip(cells, -1, 100).reshape(geometry.rows, geometry.cols))
    return grid_at(path, resolution, corner, masses)
