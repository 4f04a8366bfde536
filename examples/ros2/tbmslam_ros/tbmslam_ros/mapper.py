"""The node: `ros2 run tbmslam_ros mapper`."""

import math
import subprocess
import sys
from collections import deque

import rclpy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import LaserScan
from tf2_ros import Buffer, TransformBroadcaster, TransformException, TransformListener

from tbmslam import SE2
from tbmslam_ros.live_map import LiveMap, occupancy, planar, stamp_of

_QUEUED_SCANS = 400  # Scans that arrive while a map is computed wait here: 10 s of a 40 Hz laser.
_WAIT_S = 1.0  # Odometry usually arrives some milliseconds after the scan that it belongs to.


class Mapper(Node):
    """Maps while the robot drives."""

    def __init__(self) -> None:
        super().__init__("tbmslam")
        defaults = {
            "folder": "map",
            "period_s": 10.0,
            "odom_frame": "odom",
            "robot_frame": "base_link",
            "map_frame": "map",
        }
        self._given = {name: self.declare_parameter(name, value).value for name, value in defaults.items()}
        self._map = LiveMap()
        self._waiting: deque[LaserScan] = deque()
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, self)
        self._broadcaster = TransformBroadcaster(self)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publisher = self.create_publisher(OccupancyGrid, "map", latched)
        queue = QoSProfile(depth=_QUEUED_SCANS, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(LaserScan, "scan", self._take, queue)
        self.create_timer(self._given["period_s"], self._publish)

    def save(self) -> None:
        """Write the map, if there is one."""
        if self._map.scans:
            self._map.save(self._given["folder"])
            self.get_logger().info(f"{self._map.scans} scans -> {self._given['folder']}")

    def _take(self, message: LaserScan) -> None:
        """Place the scans whose transforms are known by now, in the order of their arrival."""
        self._waiting.append(message)
        while self._waiting:
            oldest = self._waiting[0]
            try:
                poses = self._poses(oldest)
            except TransformException as error:
                if abs(stamp_of(message) - stamp_of(oldest)) < _WAIT_S:
                    return
                self.get_logger().warning(f"scan dropped: {error}", throttle_duration_sec=5.0)
            else:
                self._broadcast(self._map.add(oldest, *poses), oldest)
            self._waiting.popleft()

    def _poses(self, message: LaserScan) -> tuple[SE2, SE2]:
        """Return the poses of the robot in the odometry's frame and of the laser on the robot."""
        stamp = Time.from_msg(message.header.stamp)
        odom_frame, robot_frame = self._given["odom_frame"], self._given["robot_frame"]
        T_odom_robot = self._looked_up(odom_frame, robot_frame, stamp)
        return T_odom_robot, self._looked_up(robot_frame, message.header.frame_id, stamp)

    def _looked_up(self, target: str, source: str, stamp: Time) -> SE2:
        transform = self._buffer.lookup_transform(target, source, stamp).transform
        return planar(transform.translation, transform.rotation)

    def _broadcast(self, T_map_odom: SE2, message: LaserScan) -> None:
        said = TransformStamped()
        said.header.stamp = message.header.stamp
        said.header.frame_id, said.child_frame_id = self._given["map_frame"], self._given["odom_frame"]
        said.transform.translation.x, said.transform.translation.y = T_map_odom.x, T_map_odom.y
        said.transform.rotation.z = math.sin(T_map_odom.theta / 2.0)
        said.transform.rotation.w = math.cos(T_map_odom.theta / 2.0)
        self._broadcaster.sendTransform(said)

    def _publish(self) -> None:
        if not self._map.scans:
            return
        grid = occupancy(self._map.finished())
        said = OccupancyGrid()
        said.header.stamp = self.get_clock().now().to_msg()
        said.header.frame_id = self._given["map_frame"]
        said.info.resolution, said.info.width, said.info.height = grid.resolution, grid.width, grid.height
        said.info.origin.position.x, said.info.origin.position.y = grid.origin_x, grid.origin_y
        said.info.origin.orientation.w = 1.0
        said.data = grid.data
        self._publisher.publish(said)


def main() -> None:
    """Run the node until it is stopped, and save the map then."""
    # A node that compiles hears no scans for a minute, so everything is compiled before it subscribes.
    subprocess.run([sys.executable, "-m", "tbmslam", "warm-up"], check=True)
    rclpy.init()
    node = Mapper()
    # The listener of tf has its own callback group: its thread receives transforms while the other places scans.
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # A callback cannot publish any more when ROS shuts down.
        if rclpy.ok():
            raise
    finally:
        executor.shutdown()
        node.destroy_node()  # A log line after the shutdown cannot be published, and ROS would complain.
        node.save()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
