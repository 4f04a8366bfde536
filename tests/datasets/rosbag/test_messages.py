from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from datasets import DatasetError, open_recording
from datasets.options import RecordingOptions
from datasets.rosbag.messages import (
    ECHOES_TYPE,
    ODOMETRY_TYPE,
    POSE_TYPE,
    SCAN_TYPE,
    TF_TYPES,
    FramedScan,
    MessageDecoder,
    NotAsUsualError,
    poses_of,
    reader_of,
    scan_of,
    standard_md5_sum,
    standard_types,
    transforms_of,
)
from datasets.rosbag.messages import standard_types as types


@pytest.mark.parametrize("msgtype", [SCAN_TYPE, ECHOES_TYPE, ODOMETRY_TYPE, POSE_TYPE, *TF_TYPES])
def test_checksums_are_those_of_the_standard_definitions(msgtype):
    assert standard_md5_sum(msgtype) == types(is_ros1=True).generate_msgdef(msgtype)[1]


def test_what_is_no_standard_type_has_no_checksum():
    assert standard_md5_sum("odd/msg/Odd") is None


def test_names_cannot_steer_the_terminal(script, tmp_path, caplog):
    script.tf(100.0, "base_link", "las\x1b[2J\ner", topic="/tf_static").drive(100.0, 103.0)
    for k in range(20):
        script.scan(100.5 + 0.1 * k, np.full(181, 3.0), frame="las\x1b[2J\ner", step=0.01)
    recording = open_recording([script.in_time_order().write(tmp_path / "run.bag")])
    assert len(list(recording)) == 20
    with pytest.raises(DatasetError, match=r"las\\x1b\[2J\\ner"):
        open_recording([tmp_path / "run.bag"], RecordingOptions(laser_frame="other"))
    assert "\x1b" not in caplog.text


KINDS = (SCAN_TYPE, ODOMETRY_TYPE, *TF_TYPES)
NAMES = st.text(max_size=12)
FLOATS = st.floats(width=32)
RANGES = arrays(np.float32, st.integers(0, 40), elements=st.floats(width=32, allow_nan=True, allow_infinity=True))
COORDINATES = st.lists(st.floats(), min_size=7, max_size=7)


@st.composite
def messages(draw: Any, is_ros1: bool, kind: str) -> Any:
    """Return any message of a type."""
    types = standard_types(is_ros1).types

    def header() -> Any:
        time = types["builtin_interfaces/msg/Time"](
            draw(st.integers(-(2**31), 2**31 - 1)), draw(st.integers(0, 2**32 - 1))
        )
        sequence = [draw(st.integers(0, 2**32 - 1))] if is_ros1 else []
        return types["std_msgs/msg/Header"](*sequence, time, draw(NAMES))

    if kind == SCAN_TYPE:
        numbers = [draw(FLOATS) for _ in range(7)]
        return types[kind](header(), *numbers, draw(RANGES), draw(RANGES))
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    if kind == ODOMETRY_TYPE:
        numbers, zero = draw(COORDINATES), vector(0.0, 0.0, 0.0)
        pose = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](*numbers[:3]), quaternion(*numbers[3:]))
        return types[kind](
            header(),
            draw(NAMES),
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.arange(36.0)),
            types["geometry_msgs/msg/TwistWithCovariance"](
                types["geometry_msgs/msg/Twist"](zero, zero), np.arange(36.0)
            ),
        )
    transforms = []
    for _ in range(draw(st.integers(0, 3))):
        numbers = draw(COORDINATES)
        transform = types["geometry_msgs/msg/Transform"](vector(*numbers[:3]), quaternion(*numbers[3:]))
        transforms.append(types["geometry_msgs/msg/TransformStamped"](header(), draw(NAMES), transform))
    return types[kind](transforms)


def written(message: Any, is_ros1: bool, kind: str, **choices: Any) -> bytes:
    """Return a message's bytes."""
    store = standard_types(is_ros1)
    return bytes((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, kind, **choices))


def by_rosbags(data: bytes, is_ros1: bool, kind: str) -> Any:
    """Return what rosbags reads, as this project's types; None where it reads nothing."""
    store = standard_types(is_ros1)
    try:
        message = (store.deserialize_ros1 if is_ros1 else store.deserialize_cdr)(data, kind)
    except Exception:  # noqa: BLE001 - rosbags raises anything on damaged bytes
        return None
    if kind == SCAN_TYPE:
        return scan_of(message)
    return list(transforms_of(message) if kind in TF_TYPES else poses_of(message))


def assert_same(content: Any, expected: Any) -> None:
    """Compare to the last bit, nan and the sign of zero included."""
    assert type(content) is type(expected)
    if isinstance(expected, FramedScan):
        assert content.scan.ranges.dtype == expected.scan.ranges.dtype == np.float32
        assert content.scan.ranges.tobytes() == expected.scan.ranges.tobytes()
        content, expected = (
            (each.frame, *each.scan._replace(ranges=np.zeros(0)), None) for each in (content, expected)
        )
        content, expected = ([each for each in one if not isinstance(each, np.ndarray)] for one in (content, expected))
    assert repr(content) == repr(expected)


@pytest.mark.parametrize("is_ros1", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_a_message_is_read_from_its_bytes_as_rosbags_reads_it(kind, is_ros1, data):
    raw = written(data.draw(messages(is_ros1, kind)), is_ros1, kind)
    expected = by_rosbags(raw, is_ros1, kind)
    assert expected is not None
    assert_same(reader_of(kind, is_cdr=not is_ros1)(raw), expected)
    assert_same(MessageDecoder(is_ros1).decoded(kind, raw), expected)


@pytest.mark.parametrize("is_ros1", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_of_damaged_bytes_as_much_is_read_as_rosbags_reads(kind, is_ros1, data):
    raw = bytearray(written(data.draw(messages(is_ros1, kind)), is_ros1, kind))
    for _ in range(data.draw(st.integers(0, 3))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(raw)) | st.just(len(raw)))
    damaged = bytes(raw[:end]) + data.draw(st.binary(max_size=6))
    assert_same(MessageDecoder(is_ros1).decoded(kind, damaged), by_rosbags(damaged, is_ros1, kind))


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_bytes_in_the_other_order_are_left_to_rosbags(kind, data):
    raw = written(data.draw(messages(False, kind)), False, kind, little_endian=False)
    with pytest.raises(NotAsUsualError):
        reader_of(kind, is_cdr=True)(raw)
    content = MessageDecoder(is_ros1=False).decoded(kind, raw)
    assert content is not None
    assert_same(content, by_rosbags(raw, False, kind))


@pytest.mark.parametrize("kind", [ECHOES_TYPE, POSE_TYPE, "std_msgs/msg/String"])
def test_rare_types_are_left_to_rosbags(kind):
    assert reader_of(kind, is_cdr=False) is None


@pytest.mark.parametrize("data", [b"", "no bytes", None])
def test_what_is_no_message_is_none(data):
    assert MessageDecoder(is_ros1=False).decoded(SCAN_TYPE, data) is None
