import math
from dataclasses import replace
from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.clouds import CloudSlice, PointCloudError, choose_slice, cloud_of, mounting, rotation_of, times_warning
from datasets.errors import DatasetError
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tests.datasets.room import LEVEL, room_cloud, wall_ranges
from tests.warnings_page import is_explained

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


LATEST = 1_790_000_000.25
"""A stamp of these years."""


@pytest.mark.parametrize(
    ("kind", "unit", "since"),
    [
        ("f4", 1.0, 0.0),
        ("f4", 1e-3, 0.0),
        ("f4", 1e-6, 0.0),  # velodyne, converted for LIO-SAM
        ("f4", 1e-9, 0.0),
        ("f8", 1.0, LATEST),
        ("f8", 1e-3, LATEST),
        ("f8", 1e-6, LATEST),
        ("f8", 1e-9, LATEST),  # livox and robosense
        ("u4", 1e-3, 0.0),
        ("u4", 1e-6, 0.0),
        ("u4", 1e-9, 0.0),
    ],
)
@pytest.mark.parametrize("sweep", [0.02, 0.1, 0.99])
def test_the_unit_of_times_is_told_by_the_duration_of_a_sweep(kind, unit, since, sweep):
    true = np.linspace(0.0, sweep, 200)
    values = np.round((true + since) / unit) if unit < 1.0 else true + since
    rows = [(1.0, 2.0, 0.5, value) for value in values.tolist()]
    said = message([("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", kind)], rows, stamp=(1_790_000_000, 300_000_000))
    cloud = cloud_of(said)
    assert cloud.times is not None
    np.testing.assert_allclose(cloud.times, true, atol=max(6e-4 if unit == 1e-3 else 0.0, 2e-6))
    assert cloud.delay == pytest.approx(LATEST - 1_790_000_000.3 if since else 0.0, abs=1e-3)
    assert cloud.unused_times is None


def test_few_points_do_not_tell_the_unit():
    """The nanoseconds of a part of a sweep, which microseconds would make half a second of."""
    rows = [(1.0, 2.0, 0.5, 5000 * k) for k in range(99)]
    cloud = cloud_of(message([("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "u4")], rows))
    assert cloud.times is not None
    assert cloud.times.max() == pytest.approx(98 * 5000e-9)


@pytest.mark.parametrize(("step", "warned"), [(0.0, False), (0.0005, False), (0.05, True), (1e9, True), (np.nan, True)])
def test_times_that_cannot_be_used_cause_a_warning(step, warned):
    rows = [(1.0, 2.0, 0.5, step * k) for k in range(200)]
    cloud = cloud_of(message([("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f8")], rows))
    unknown = cloud._replace(times=None, unused_times=None)
    warning = times_warning([cloud, cloud, unknown])
    assert (warning is not None) is warned
    assert times_warning([cloud, unknown]) is None
    if warning is not None:
        assert warning.startswith(f"the times of the points (field time, {199 * step:.6g} from first to last) last as")
        assert is_explained(warning)


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


QUARTER = math.sqrt(0.5)
MOUNTS = {
    "level": LEVEL,
    "turned by 90 degrees": LEVEL._replace(qz=QUARTER, qw=QUARTER),
    "upside down": LEVEL._replace(qx=1.0, qw=0.0),
    "a camera's optical frame": LEVEL._replace(qx=-0.5, qy=0.5, qz=-0.5, qw=0.5),
    "tilted by 20 degrees": LEVEL._replace(qy=math.sin(math.radians(10.0)), qw=math.cos(math.radians(10.0))),
}


def cut_of(mount, step_deg=0.4):
    beams = round(360.0 / step_deg)
    return CloudSlice(mount, 0.35, 0.85, 0.0, -math.pi, math.radians(step_deg), beams)


def expected(cut):
    angles = cut.angle_min + cut.angle_step * np.arange(cut.beams)
    return wall_ranges(cut.T_robot_scan.x, cut.T_robot_scan.y, angles)


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
def test_walls_are_where_they_are_however_the_sensor_is_mounted(mount):
    cut = cut_of(mount)
    assert cut.T_robot_scan == SE2(0.3, 0.1, 0.0)
    scan = cut.scan(room_cloud(mount))
    errors = np.abs(scan.ranges - expected(cut))
    assert np.sort(errors)[-8] < 5e-5  # but for the corners


@given(st.floats(0.0, 0.4), st.sampled_from([0.2, 0.25, 0.4, 0.5]))
def test_a_wall_is_straight_wherever_the_beams_of_the_sensor_are(offset_deg, step_deg):
    cut = cut_of(LEVEL, step_deg)
    scan = cut.scan(room_cloud(offset_deg=offset_deg, step_deg=step_deg))
    assert np.sort(np.abs(scan.ranges - expected(cut)))[-12] < 2e-4


def test_the_floor_and_what_is_above_are_left_out():
    cloud = room_cloud(rings=(-0.25, 0.0))
    assert np.isfinite(cut_of(LEVEL).scan(cloud).ranges).all()
    floor = replace(cut_of(LEVEL), low=-0.1, high=0.1).scan(cloud)
    np.testing.assert_allclose(floor.ranges[np.isfinite(floor.ranges)], 2.4, atol=1e-6)
    assert not np.isfinite(replace(cut_of(LEVEL), low=1.0, high=2.0).scan(cloud).ranges).any()


def test_what_is_near_hides_what_is_behind_and_noise_is_averaged():
    cloud = room_cloud(rings=(0.0,), offset_deg=0.0)
    noise = np.random.default_rng(1).normal(0.0, 0.01, (8, len(cloud.points)))
    rings = [cloud.points * (1.0 + each / np.linalg.norm(cloud.points, axis=1))[:, None] for each in noise]
    cut = cut_of(LEVEL)
    errors = cut.scan(cloud._replace(points=np.concatenate(rings))).ranges - expected(cut)
    assert np.std(errors) < 0.01 / math.sqrt(8) * 1.2
    assert abs(np.mean(errors)) < 0.001
    post = 0.5 * cloud.points[:20]
    hidden = cut.scan(cloud._replace(points=np.concatenate([cloud.points, post]))).ranges
    np.testing.assert_allclose(hidden[:20], 0.5 * expected(cut)[:20], atol=1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_stamp_is_that_of_the_first_beam(sign):
    cloud = room_cloud(turn_s=0.1, sign=sign)._replace(delay=-0.1)
    cut = replace(cut_of(LEVEL), angle_step=sign * math.radians(0.4), time_step=0.1 / 900)
    scan = cut.scan(cloud)
    assert scan.stamp == pytest.approx(99.9, abs=2e-4)
    assert (scan.time_increment, scan.angle_increment) == (cut.time_step, cut.angle_step)
    np.testing.assert_allclose(np.median(np.abs(scan.ranges - expected(cut))), 0.0, atol=5e-5)
    assert cut.scan(cloud._replace(stamp=0.0)).stamp == 0.0  # unset stays unset


def test_an_empty_cloud_gives_an_empty_scan():
    scan = cut_of(LEVEL).scan(room_cloud()._replace(points=np.zeros((0, 3))))
    assert np.isnan(scan.ranges).all()
    assert len(scan.ranges) == 900


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(x * x for x in q) > 1e-3))
def test_the_matrix_turns_as_the_motion_does(values):
    pose = SE3.from_values(0.0, 0.0, 0.0, *values)
    for axis, column in zip(np.eye(3), rotation_of(pose).T, strict=True):
        np.testing.assert_allclose((pose @ SE3(*axis, 0.0, 0.0, 0.0, 1.0))[:3], column, atol=1e-12)


HANGING = SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def chosen(clouds, mount=LEVEL, heights=None, step_deg=None):
    return choose_slice(mount, heights, step_deg, clouds, "a.bag: the clouds of /points")


@pytest.mark.parametrize("step_deg", [0.2, 0.4, 0.5, 1.0])
def test_the_beams_are_as_fine_as_the_points(step_deg):
    cut = chosen([room_cloud(step_deg=step_deg)] * 3)
    assert (math.degrees(cut.angle_step), cut.beams) == (pytest.approx(step_deg), round(360.0 / step_deg))
    assert cut.time_step == 0.0
    assert chosen([room_cloud(step_deg=step_deg)], step_deg=2.0).beams == 180
    assert chosen([room_cloud(step_deg=step_deg)], step_deg=-2.0) == chosen(
        [room_cloud(step_deg=step_deg)], step_deg=2.0
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sensor_that_turns_is_measured(sign):
    cut = chosen([room_cloud(turn_s=0.1, sign=sign), room_cloud(turn_s=0.1004, sign=sign)])
    assert cut.angle_step == pytest.approx(sign * math.radians(0.4))
    assert cut.time_step * cut.beams == pytest.approx(0.1, rel=5e-3)
    assert abs(math.remainder(cut.angle_min - math.pi, 2.0 * math.pi)) < math.radians(2.0)


def test_times_in_no_order_mean_that_nothing_turns():
    cloud = room_cloud(turn_s=0.1)
    shuffled = cloud._replace(times=np.random.default_rng(3).permutation(cloud.times))
    assert chosen([shuffled] * 4).time_step == 0.0


def test_the_heights_are_around_the_sensor_and_above_the_floor():
    assert (chosen([room_cloud()]).low, chosen([room_cloud()]).high) == (pytest.approx(0.35), pytest.approx(0.85))
    low = LEVEL._replace(z=0.3)
    assert chosen([room_cloud(low)], low).low == pytest.approx(0.1)
    unknown = LEVEL._replace(z=0.0)  # heights count from the sensor
    assert chosen([room_cloud(unknown, rings=(0.0,))], unknown).low == pytest.approx(-0.25)
    assert (chosen([room_cloud()], heights=(0.5, 0.7)).low, chosen([room_cloud()], heights=(0.5, 0.7)).high) == (
        0.5,
        0.7,
    )


def test_the_slice_opens_upwards_unless_heights_are_stated():
    slopes = np.tan(np.radians([-1.0, 1.0, 3.0]))
    far = room_cloud()._replace(points=20.0 * np.column_stack((np.ones(3), np.zeros(3), slopes)))
    kept, _ = chosen([room_cloud()]).points(far)
    np.testing.assert_allclose(kept, [(20.0, 0.0)])  # the rising ring next to the horizon
    assert not len(chosen([room_cloud()], heights=(0.35, 0.85)).points(far)[0])


def test_a_slice_without_walls_is_refused_with_the_heights_that_there_are():
    said = (
        r"a\.bag: the clouds of /points hold hardly any point between 1\.00 and 2\.00 m above the robot's frame; they "
        r"lie mostly between 0\.00 and 0\.\d\d m: choose heights at which there are walls with --cloud-heights"
    )
    with pytest.raises(DatasetError, match=said):
        chosen([room_cloud()], heights=(1.0, 2.0))
    with pytest.raises(DatasetError, match="they are empty"):
        chosen([room_cloud()._replace(points=np.zeros((0, 3)))])


@pytest.mark.parametrize(
    ("turn", "top", "said"),
    [
        (0.1, 0.2, "/points lie at the right heights, but in 6 of 360 degrees"),
        (0.1, 3.0, "/points hold hardly any point .* lie mostly between"),
        (6.0, 0.2, "/points hold hardly any point .* lie mostly between"),
    ],
    ids=["few directions", "also other heights", "all directions, but too far"],
)
def test_why_a_slice_is_empty(turn, top, said):
    angles, heights = np.linspace(0.0, turn, 400), np.linspace(0.1, top, 400)
    points = 1e4 * np.column_stack((np.cos(angles), np.sin(angles), 1e-4 * heights))
    with pytest.raises(DatasetError, match=said):
        chosen([room_cloud()._replace(points=points)])


def test_a_slice_without_walls_of_a_sensor_at_an_unknown_place():
    said = (
        r"a\.bag: the clouds of /points hold hardly any point between 1\.00 and 2\.00 m above the sensor, if it is "
        r"level: tf lacks the mount of its frame lidar\. They lie mostly between .* m: record tf and tf_static with "
        r"the mount; if the sensor is level, choose heights at which there are walls with --cloud-heights"
    )
    with pytest.raises(DatasetError, match=said):
        choose_slice(SE3.identity(), (1.0, 2.0), None, [room_cloud()], "a.bag: the clouds of /points", "lidar")


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_camera_at_a_stated_place_looks_ahead(upside_down):
    mount = mounting(None, SE2(0.2, 0.0, math.pi / 2), upside_down, "head/camera_depth_optical_frame")
    right, down, ahead = rotation_of(mount).T
    sign = -1.0 if upside_down else 1.0
    np.testing.assert_allclose(ahead, (0.0, 1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(right, (sign, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(down, (0.0, 0.0, -sign), atol=1e-12)
    assert mounting(None, None, None, "optical_table/lidar") == SE3.identity()


def test_a_stated_mount_replaces_that_of_tf_in_the_plane():
    tilted = LEVEL._replace(qy=math.sin(0.2), qw=math.cos(0.2))
    stated = SE2(1.0, 2.0, 0.7)
    assert mounting(tilted, None, None) == tilted
    both = mounting(tilted, stated, None)
    assert both.planar() == pytest.approx(stated)
    assert (both.z, both.up()) == (pytest.approx(0.6), pytest.approx(tilted.up()))
    assert mounting(None, None, None) == SE3.identity()
    assert mounting(None, stated, None).planar() == pytest.approx(stated)
    assert mounting(None, None, True) == HANGING


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_stated_mount_is_the_direction_in_which_a_camera_looks_with_and_without_tf(tilt):
    frame, stated = "camera_optical_frame", SE2(0.3, 0.1, 0.5)
    in_tf = SE3(0.0, 0.0, 0.6, 0.0, math.sin(tilt), 0.0, math.cos(tilt)) @ mounting(None, None, None, frame)
    for mount in (mounting(in_tf, stated, None, frame), mounting(None, stated, None, frame)):
        x, y, _ = mount.rotated(0.0, 0.0, 1.0)
        assert math.atan2(y, x) == pytest.approx(0.5)
        assert (mount.x, mount.y) == pytest.approx((0.3, 0.1))


@pytest.mark.parametrize(("frame", "up"), [("lidar", (0.0, 0.0, 1.0)), ("camera_optical_frame", (0.0, -1.0, 0.0))])
def test_the_side_that_is_up_is_stated_regardless_of_tf(frame, up):
    """The sensor keeps its place, its tilt and the direction in which it looks."""
    ahead = (1.0, 0.0, 0.0) if frame == "lidar" else (0.0, 0.0, 1.0)
    upright = SE3(0.3, 0.1, 0.6, 0.0, math.sin(0.2), 0.0, math.cos(0.2)) @ mounting(None, None, None, frame)
    hanging = mounting(upright, None, True, frame)
    assert hanging[:3] == upright[:3]
    np.testing.assert_allclose(hanging.rotated(*ahead), upright.rotated(*ahead), atol=1e-12)
    assert hanging.rotated(*up)[2] == pytest.approx(-upright.rotated(*up)[2])
    assert mounting(upright, None, False, frame) == upright
    assert mounting(hanging, None, True, frame) == hanging
    np.testing.assert_allclose(rotation_of(mounting(hanging, None, False, frame)), rotation_of(upright), atol=1e-12)
