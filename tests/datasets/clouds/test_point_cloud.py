from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.clouds.point_cloud import PointCloudError, cloud_of

NUMBERS = {"f4": 7, "f8": 8, "u4": 6, "u2": 4}
POINTS = [(1.0, 2.0, 0.5), (np.nan, 0.0, 0.0), (3.0, -4.0, 0.25), (5.0, 6.0, -1.0)]


def message(fields, rows, *, order="<", lines=1, padding=0, stamp=(100, 5)):
    """Return a PointCloud2 of rows of values; `fields` names them and their types, lines are padded."""
    dtype = np.dtype([(name, order + kind) for name, kind in fields])
    data = np.array([tuple(row) for row in rows], dtype).reshape(lines, -1)
    texts = b"".join(line.tobytes() + b"\xff" * padding for line in data)
    return Message(
        header=Message(stamp=Message(sec=stamp[0], nanosec=stamp[1]), frame_id="lidar"),
        height=lines,
        width=data.shape[1],
        fields=[
            Message(name=name, offset=dtype.fields[name][1], datatype=NUMBERS[kind], count=1) for name, kind in fields
        ],
        is_bigendian=order == ">",
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * data.shape[1] + padding,
        data=np.frombuffer(texts, np.uint8),
    )


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize(("lines", "padding"), [(1, 0), (2, 0), (2, 12)])
def test_points_of_any_layout(order, kind, lines, padding):
    fields = [("intensity", "u2"), ("z", kind), ("y", kind), ("x", kind)]
    rows = [(7, z, y, x) for x, y, z in POINTS]
    cloud = cloud_of(message(fields, rows, order=order, lines=lines, padding=padding))
    assert (cloud.frame, cloud.stamp, cloud.times, cloud.delay) == ("lidar", 100.000000005, None, 0.0)
    np.testing.assert_array_equal(cloud.points, [POINTS[0], POINTS[2], POINTS[3]])


@pytest.mark.parametrize(
    ("name", "kind", "values", "delay"),
    [
        ("time", "f4", (-0.5, -0.4, -0.3, -0.2), -0.5),  # velodyne: after the stamp
        ("t", "u4", (0, 100_000_000, 200_000_000, 300_000_000), 0.0),  # ouster: nanoseconds
        ("timestamp", "f8", (99.75, 99.85, 99.95, 100.05), -0.25),  # hesai: time of the day
    ],
)
def test_times_of_points(name, kind, values, delay):
    rows = [(*point, value) for point, value in zip(POINTS, values, strict=True)]
    cloud = cloud_of(message([("x", "f4"), ("y", "f4"), ("z", "f4"), (name, kind)], rows))
    np.testing.assert_allclose(cloud.times, (0.0, 0.2, 0.3), atol=1e-6)
    assert cloud.delay == pytest.approx(delay, abs=1e-6)


@pytest.mark.parametrize("values", [(0.0,) * 4, (0.0, 1.0, 2.0, 3.0), (np.nan,) * 4, (0.0, np.inf, np.inf, 0.1)])
def test_times_that_cannot_be_meant_are_none(values):
    rows = [(*point, value) for point, value in zip(POINTS, values, strict=True)]
    assert cloud_of(message([("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f4")], rows)).times is None


def test_clouds_without_places_or_cut_off_are_refused():
    with pytest.raises(PointCloudError, match="fields x, y and z are missing, there are x, y"):
        cloud_of(message([("x", "f4"), ("y", "f4")], [(1.0, 2.0)]))
    cut = message([("x", "f4"), ("y", "f4"), ("z", "f4")], POINTS)
    cut.data = cut.data[:-1]
    with pytest.raises(PointCloudError, match="1 rows of 4 points take more than its 47 bytes"):
        cloud_of(cut)


def test_an_empty_cloud_holds_nothing():
    assert cloud_of(message([("x", "f4"), ("y", "f4"), ("z", "f4")], [])).points.shape == (0, 3)


@given(
    st.integers(0, 40), st.integers(0, 5), st.integers(0, 5), st.integers(0, 80),
    st.lists(st.tuples(st.sampled_from("xyzt"), st.integers(0, 30), st.integers(0, 9), st.integers(0, 2)), max_size=6),
    st.binary(max_size=200),
)  # fmt: skip
def test_no_message_does_more_than_be_refused(point_step, height, width, row_step, fields, data):
    said = Message(
        header=Message(stamp=Message(sec=1, nanosec=2), frame_id="lidar"),
        height=height, width=width, is_bigendian=bool(width % 2), point_step=point_step, row_step=row_step,
        fields=[Message(name=n, offset=o, datatype=d, count=c) for n, o, d, c in fields],
        data=np.frombuffer(data, np.uint8),
    )  # fmt: skip
    try:
        cloud = cloud_of(said)
    except PointCloudError:
        return
    assert cloud.points.shape[1:] == (3,)
    assert np.isfinite(cloud.points).all()
