"""Bytes of a bag's messages as this project's types."""

import logging
from typing import Any

from datasets.clouds.point_cloud import PointCloud, PointCloudError, cloud_of
from datasets.rosbag.message_bytes import Content, reader_of
from datasets.rosbag.message_types import CLOUD_TYPE, ECHOES_TYPE, SCAN_TYPE, TF_TYPES, standard_types
from datasets.rosbag.messages import poses_of, scan_of, transforms_of

logger = logging.getLogger(__name__)


class MessageDecoder:
    """Decodes messages by the standard definitions of their types.

    Parameters
    ----------
    is_ros1
        Whether they are written as in ROS 1.
    """

    def __init__(self, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self._readers = {name: reader_of(name, is_cdr=not is_ros1) for name in (SCAN_TYPE, *TF_TYPES)}

    def decoded(self, msgtype: str, data: bytes) -> Content | PointCloud | None:
        """Return what a message says; None where its bytes cannot be decoded."""
        if msgtype not in self._readers:
            self._readers[msgtype] = reader_of(msgtype, is_cdr=not self._is_ros1)
        read = self._readers[msgtype]
        if read is not None:
            try:
                return read(data)
            except Exception as error:  # noqa: BLE001 - a damaged database may even hold what are no bytes
                logger.debug("a %s is not laid out as usual: %r", msgtype, error)
        return self._by_rosbags(msgtype, data)

    def _by_rosbags(self, msgtype: str, data: bytes) -> Content | PointCloud | None:
        """Return the same, whatever the type and the order of bytes."""
        try:
            store = standard_types(self._is_ros1)
            message = (store.deserialize_ros1 if self._is_ros1 else store.deserialize_cdr)(data, msgtype)
        except Exception as error:  # noqa: BLE001 - rosbags raises anything on damaged bytes
            logger.debug("a %s cannot be decoded: %r", msgtype, error)
            return None
        if msgtype in (SCAN_TYPE, ECHOES_TYPE):
            return scan_of(message)
        if msgtype == CLOUD_TYPE:
            return _cloud(message)
        return list(transforms_of(message) if msgtype in TF_TYPES else poses_of(message))


def _cloud(message: Any) -> PointCloud | None:
    """Return the points of a message; None where it holds none in space."""
    try:
        return cloud_of(message)
    except PointCloudError as error:
        logger.debug("a point cloud cannot be read: %s", error)
        return None
