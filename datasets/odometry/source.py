"""The source of the odometry in one pass: tf, a topic, or none; and the mount of the laser."""

import math
from functools import reduce
from operator import matmul

from datasets.errors import DatasetError
from datasets.odometry.frames import Frames, Step, plain
from datasets.odometry.se3 import SE3
from datasets.odometry.synchronisation import PoseHistory
from tbmslam.geometry.se2 import SE2

_STEEPEST = math.cos(math.radians(60.0))


class Mounting:
    """The mount of the laser on the robot.

    `steps` is the path from the robot's frame to the laser's; without one the laser is at the centre. `sensor_pose` and
    `upside_down` replace the recorded mount. Errors begin with the name of the recording.
    """

    def __init__(
        self,
        steps: list[Step] | None,
        sensor_pose: SE2 | None,
        upside_down: bool | None,
        recording: str = "the recording",
    ) -> None:
        self._recording = recording
        self._steps = steps or []
        self._sensor_pose = sensor_pose
        self._upside_down = upside_down
        self._histories = {step.edge.key: PoseHistory(100) for step in self._steps if not step.edge.is_fixed}
        self._constant = None if self._histories and sensor_pose is None else self._at(0.0)

    def add(self, parent: str, child: str, stamp: float, pose: SE3) -> None:
        """Add a transform, if it belongs to the path to the laser."""
        history = self._histories.get((plain(parent), plain(child)))
        if history is not None:
            history.add(stamp, pose)

    def at(self, stamp: float) -> tuple[SE2, bool]:
        """Return T_robot_sensor in the plane, and whether the laser is mounted upside down."""
        return self._constant if self._constant is not None else self._at(stamp)

    def _at(self, stamp: float) -> tuple[SE2, bool]:
        """Compose the steps at a stamp."""
        pose = SE3.identity()
        for step in self._steps:
            history = self._histories.get(step.edge.key)
            known = history.nearest(stamp) if history is not None else None
            pose = pose @ _along(step, known if known is not None else step.edge.first)
        up = pose.up()
        if self._sensor_pose is not None:
            return self._sensor_pose, self._upside_down if self._upside_down is not None else up < 0.0
        if abs(up) < _STEEPEST:
            raise DatasetError(
                f"{self._recording}: the laser in frame {self._steps[-1].edge.child} scans "
                f"{math.degrees(math.acos(abs(up))):.0f} degrees off the horizontal: choose another with --scan-topic, "
                "or set its pose with --sensor-pose"
            )
        return pose.planar(), self._upside_down if self._upside_down is not None else up < 0.0


class NoMotion:
    """No odometry: only the mount of the laser."""

    def __init__(self, mounting: Mounting) -> None:
        self._mounting = mounting

    def add_transform(self, parent: str, child: str, stamp: float, pose: SE3) -> None:
        """Add a transform: the laser may be mounted on a moving part."""
        self._mounting.add(parent, child, stamp, pose)

    def mounting(self, stamp: float) -> tuple[SE2, bool]:
        """Return T_robot_sensor and whether the laser is mounted upside down."""
        return self._mounting.at(stamp)

    def histories(self) -> list[PoseHistory]:
        """Return the recorded poses: none."""
        return []

    def odometry(self, poses: list[SE3]) -> SE2 | None:  # noqa: ARG002
        """Return None: there is no odometry."""
        return None


class TopicMotion(NoMotion):
    """Odometry from the poses of a topic or of a log."""

    def __init__(self, mounting: Mounting) -> None:
        super().__init__(mounting)
        self._history = PoseHistory()

    def add(self, stamp: float, pose: SE3) -> None:
        """Add a pose."""
        self._history.add(stamp, pose)

    def histories(self) -> list[PoseHistory]:
        """Return the poses of the topic."""
        return [self._history]

    def odometry(self, poses: list[SE3]) -> SE2:
        """Return T_odom_robot."""
        return poses[0].planar()


class TfMotion(NoMotion):
    """Odometry from the path from the odometry frame to the robot in tf."""

    def __init__(self, frames: Frames, mounting: Mounting) -> None:
        super().__init__(mounting)
        self._steps = frames.to_robot
        self._histories = {step.edge.key: PoseHistory() for step in self._steps if not step.edge.is_fixed}
        self._is_one_step = len(self._steps) == 1 and self._steps[0].down

    def add_transform(self, parent: str, child: str, stamp: float, pose: SE3) -> None:
        """Add a transform."""
        history = self._histories.get((plain(parent), plain(child)))
        if history is not None:
            history.add(stamp, pose)
        else:
            super().add_transform(parent, child, stamp, pose)

    def histories(self) -> list[PoseHistory]:
        """Return the poses of the moving edges."""
        return list(self._histories.values())

    def odometry(self, poses: list[SE3]) -> SE2:
        """Return T_odom_robot from one pose of each moving edge."""
        if self._is_one_step:  # the usual case
            return poses[0].planar()
        moving = iter(poses)
        steps = [_along(step, step.edge.first if step.edge.is_fixed else next(moving)) for step in self._steps]
        return reduce(matmul, steps).planar()


def pose_along(steps: list[Step]) -> SE3:
    """Return the pose at the end of a path of frames, by the first transform of each edge."""
    return reduce(matmul, (_along(step, step.edge.first) for step in steps), SE3.identity())


def _along(step: Step, pose: SE3) -> SE3:
    """Return the motion of a step in its direction."""
    return pose if step.down else pose.inverse()
