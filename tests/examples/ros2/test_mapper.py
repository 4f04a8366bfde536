"""The ROS 2 node under ROS: its own process, real topics; only tf2_ros, which has no wheel, is a stand-in."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, simulate
from tbmslam import load_map

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
LATE_S = 0.05  # odometry that arrives after its scan, as on most robots
SPEED = 2.0  # as fast as the drive was


@pytest.fixture
def ros(monkeypatch, tmp_path):
    """ROS 2 in this process, in a domain of its own."""
    rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed: see examples/ros2/README.md")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.syspath_prepend(str(HERE))
    rclpy.init()
    yield rclpy
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def robot():
    world = make_world("apartment", 3)
    laser = SimulatedLaser(beams=181, angle_min=-math.pi / 2.0, angle_increment=math.radians(1.0), rate=10.0)
    return simulate(world, plan_drives(world, 1, length=10.0, seed=3), laser, OdometryNoise.preset("good"), 3)[0]


class Robot:
    """A robot that publishes a simulated drive, and hears the map."""

    def __init__(self, rclpy, readings):
        from geometry_msgs.msg import TransformStamped
        from nav_msgs.msg import OccupancyGrid
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import LaserScan
        from tf2_ros import LATCHED, QUEUE, STATIC_TOPIC, TOPIC

        self._readings, self.maps = readings, []
        self._rclpy, self._node = rclpy, rclpy.create_node("robot")
        self._scans = self._node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._moving = self._node.create_publisher(TransformStamped, TOPIC, QUEUE)
        self._static = self._node.create_publisher(TransformStamped, STATIC_TOPIC, LATCHED)
        self._node.create_subscription(OccupancyGrid, "map", self.maps.append, LATCHED)
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self):
        try:
            self._rclpy.spin(self._node)
        except self._rclpy.executors.ExternalShutdownException:
            return

    def wait_for_listeners(self):
        """Wait until the node has subscribed."""
        for _ in range(1800):
            if self._scans.get_subscription_count() and self._moving.get_subscription_count():
                return
            time.sleep(0.1)
        raise TimeoutError("the node does not subscribe")

    def wait_for_the_last_map(self):
        """Wait until a map is like the one before it, and both are later than the drive."""
        known = len(self.maps)
        for _ in range(600):
            if len(self.maps) > known + 1 and self.maps[-1].data == self.maps[-2].data:
                return
            time.sleep(0.1)
        raise TimeoutError("the maps do not come to an end")

    def drive(self):
        """Publish each scan at its time, and its odometry later."""
        from tf2_ros import message_of

        self._static.publish(message_of("base_link", "laser", self._time(0), self._readings[0].T_robot_sensor))
        events = [(reading.scan.stamp, "scan", index) for index, reading in enumerate(self._readings)]
        events += [(reading.scan.stamp + LATE_S, "odometry", index) for index, reading in enumerate(self._readings)]
        begin, first = time.monotonic(), self._readings[0].scan.stamp
        for stamp, kind, index in sorted(events):
            time.sleep(max(0.0, begin + (stamp - first) / SPEED - time.monotonic()))
            if kind == "scan":
                self._scans.publish(self._scan(index))
            else:
                pose = self._readings[index].T_odom_robot
                self._moving.publish(message_of("odom", "base_link", self._time(index), pose))

    def _time(self, index):
        return self._rclpy.time.Time(nanoseconds=round(1e9 * self._readings[index].scan.stamp)).to_msg()

    def _scan(self, index):
        from sensor_msgs.msg import LaserScan

        scan, said = self._readings[index].scan, LaserScan()
        said.header.stamp, said.header.frame_id = self._time(index), "laser"
        said.angle_min, said.angle_increment = scan.angle_min, scan.angle_increment
        said.range_min, said.range_max = scan.range_min, scan.range_max
        said.ranges = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf).tolist()
        return said


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what generates ROS's messages
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_the_node_maps_a_drive_whose_odometry_comes_late(ros, robot, tmp_path, stop):
    published = Robot(ros, robot.readings)
    paths = os.pathsep.join(map(str, (ROOT, HERE, ROOT / "examples" / "ros2" / "tbmslam_ros")))
    node = subprocess.Popen(
        [sys.executable, "-m", "tbmslam_ros.mapper", "--ros-args", "-p", "folder:=map", "-p", "period_s:=2.0"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        published.wait_for_listeners()
        published.drive()
        published.wait_for_the_last_map()
        node.send_signal(stop)
        said, _ = node.communicate(timeout=60)
    finally:
        node.kill()
    assert node.returncode == 0, said
    assert "Traceback" not in said
    saved = load_map(tmp_path / "map")
    assert len(saved.drives[0].trajectory) >= len(robot.readings) - 2  # the last ones may lack later odometry
    last = published.maps[-1]
    assert len(published.maps) >= 3
    assert last.header.frame_id == "map"
    assert list(last.data) == saved.to_occupancy().ravel().tolist()
    assert (last.info.height, last.info.width) == (saved.grid.geometry.rows, saved.grid.geometry.cols)
