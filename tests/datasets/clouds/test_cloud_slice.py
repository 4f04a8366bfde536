import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.clouds.cloud_slice import CloudSlice, rotation_of
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tests.datasets.clouds.room import LEVEL, room_cloud, wall_ranges

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
    return CloudSlice(mount, 0.35, 0.85, -math.pi, math.radians(step_deg), beams)


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
