"""The part of the ROS 2 example that is not ROS, fed with messages of a simulated drive."""

import ast
import importlib.util
import math
from pathlib import Path
from types import SimpleNamespace as Message

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam import load_map

PACKAGE = Path(__file__).parents[3] / "examples" / "ros2" / "tbmslam_ros" / "tbmslam_ros"


@pytest.fixture(scope="module")
def live_map():
    spec = importlib.util.spec_from_file_location("live_map", PACKAGE / "live_map.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def robot():
    world = make_world("apartment", 3)
    laser = SimulatedLaser(beams=181, angle_min=-math.pi / 2.0, angle_increment=math.radians(1.0), rate=5.0)
    drives = plan_drives(world, 1, length=20.0, seed=3)
    return simulate(world, drives, laser, OdometryNoise.preset("good"), 3)[0]


def message_of(scan):
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, 65.533).astype(np.float32)
    stamp = Message(sec=int(scan.stamp), nanosec=round(1e9 * (scan.stamp % 1.0)))
    return Message(
        header=Message(stamp=stamp, frame_id="laser"), angle_min=scan.angle_min, angle_increment=scan.angle_increment,
        range_min=scan.range_min, range_max=scan.range_max, ranges=ranges.tolist(),
    )  # fmt: skip


def test_a_drive_becomes_poses_maps_and_a_folder(live_map, robot, tmp_path):
    mapper = live_map.LiveMap("rosie")
    begin = robot.truth.pose(0)
    for index, reading in enumerate(robot.readings):
        T_map_odom = mapper.add(message_of(reading.scan), reading.T_odom_robot, reading.T_robot_sensor)
        if index == len(robot.readings) // 2:
            halfway = live_map.occupancy(mapper.finished())
    T_map_robot = T_map_odom @ robot.readings[-1].T_odom_robot
    true = begin.inverse() @ robot.truth.pose(-1)
    first = robot.readings[0].T_odom_robot
    assert (first.inverse() @ T_map_robot)[:2] == pytest.approx(true[:2], abs=0.05)
    whole = live_map.occupancy(mapper.finished())
    assert whole.data.count(0) > halfway.data.count(0) > 1000
    assert len(whole.data) == whole.width * whole.height
    assert set(whole.data) == {-1, 0, 100}
    mapper.save(str(tmp_path / "map"))
    saved = load_map(tmp_path / "map")
    assert saved.drives[0].name == "rosie"
    assert saved.to_occupancy().ravel().tolist() == whole.data


def test_ranges_outside_the_limits_of_a_scan(live_map):
    message = Message(
        header=Message(stamp=Message(sec=7, nanosec=500_000_000), frame_id="laser"), angle_min=-1.0,
        angle_increment=0.5, range_min=0.1, range_max=30.0, ranges=[0.0, 2.0, 30.0, math.inf, math.nan],
    )  # fmt: skip
    scan = live_map.scan_of(message)
    assert scan.stamp == 7.5
    np.testing.assert_array_equal(scan.ranges, [np.nan, 2.0, np.inf, np.inf, np.nan])


@pytest.mark.parametrize("theta", [-3.0, 0.0, 0.4, 2.5])
def test_the_plane_s_share_of_a_transform(live_map, theta):
    rotation = Message(x=0.0, y=0.0, z=math.sin(theta / 2.0), w=math.cos(theta / 2.0))
    assert live_map.planar(Message(x=1.0, y=2.0, z=9.0), rotation) == pytest.approx((1.0, 2.0, theta))


def test_the_node_uses_what_there_is(live_map):
    tree = ast.parse((PACKAGE / "mapper.py").read_text(encoding="utf-8"))
    (ours,) = [
        node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == "tbmslam_ros.live_map"
    ]
    assert all(hasattr(live_map, name.name) for name in ours.names)
    called = {
        node.attr for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "_map"
    }  # fmt: skip
    assert called <= set(dir(live_map.LiveMap()))
    assert called
