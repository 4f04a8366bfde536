"""One robot: readings in, a map out."""

import logging
from collections.abc import Mapping

import numpy as np

from tbmslam.config import SlamConfig
from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.grid_tracker import GridTracker, GridTrackerConfig
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.mapping import ScanInserter
from tbmslam.motion import MotionModel
from tbmslam.se2 import SE2
from tbmslam.surfel_tracker import SurfelTracker
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.tracker import Tracker
from tbmslam.trajectory import Trajectory

_log = logging.getLogger(__name__)


class Slam:
    """Maps while it localises.

    Parameters
    ----------
    config
        Every parameter; see `tbmslam.config.preset`.
    name
        The robot's name in the map.
    """

    def __init__(self, config: SlamConfig | None = None, name: str = "robot") -> None:
        self.config = config or SlamConfig()
        self.name = name
        self._motion = MotionModel(self.config.motion)
        self._inserter = ScanInserter(self.config.map.sensor_model, self.config.map.insertion)
        self._tracker = self._make_tracker()
        self._stamps: list[float] = []
        self._poses: list[SE2] = []
        self._keyframe_scans: list[LaserScan] = []
        self._keyframe_indices: list[int] = []
        self._keyframe_sensor_poses: list[SE2] = []

    def process(self, reading: Reading) -> SE2:
        """Place one reading, learn from it, and return the robot's pose T_map_robot."""
        scan, T_robot_sensor = reading.scan, reading.T_robot_sensor
        prediction = self._motion.predict(reading)
        match = self._tracker.match(scan, prediction.T_map_robot @ T_robot_sensor, prediction.deviations)
        T_map_robot = match.T_map_sensor @ T_robot_sensor.inverse()
        self._motion.correct(reading, T_map_robot)
        if self._tracker.is_novel(match) or self._has_moved_to(T_map_robot):
            self._tracker.learn(scan, match)
            self._keyframe_scans.append(scan)
            self._keyframe_indices.append(len(self._poses))
            self._keyframe_sensor_poses.append(T_robot_sensor)
        self._stamps.append(scan.stamp)
        self._poses.append(T_map_robot)
        return T_map_robot

    def finish(self, provenance: Mapping[str, object] | None = None) -> TbmMap:
        """Return the map of everything processed so far."""
        trajectory = Trajectory(np.array(self._stamps), np.array(self._poses, dtype=np.float64).reshape(-1, 3))
        keyframe_poses = [self._poses[index] for index in self._keyframe_indices]
        keyframes = Keyframes.from_scans(self._keyframe_scans, keyframe_poses, self._keyframe_sensor_poses)
        evidence = self._tracker.grid or self._rendered(keyframes)
        grid = evidence.to_tbm_grid(self.config.map.keep_conflict).cropped_to_known()
        _log.info("%s: %d scans, %d keyframes, %.1f m", self.name, len(trajectory), len(keyframes), trajectory.length())
        return TbmMap(grid, (Drive(self.name, trajectory, keyframes),), dict(provenance or {}))

    def _rendered(self, keyframes: Keyframes) -> EvidenceGrid:
        """Draw the grid from the keyframes at their final poses."""
        grid = self._empty_grid()
        for index in range(len(keyframes)):
            self._inserter.insert(keyframes.scan(index), keyframes.sensor_pose(index), grid)
        return grid

    def _empty_grid(self) -> EvidenceGrid:
        return EvidenceGrid(self.config.map.resolution, self.config.map.max_cells)

    def _has_moved_to(self, T_map_robot: SE2) -> bool:
        """Tell whether the robot is far enough from its last keyframe for a new one."""
        if not self._keyframe_indices:
            return True
        step = self._poses[self._keyframe_indices[-1]].inverse() @ T_map_robot
        limits = self.config.keyframes
        return step.x**2 + step.y**2 >= limits.distance**2 or abs(step.theta) >= limits.angle

    def _make_tracker(self) -> Tracker:
        config = self.config.tracker
        if isinstance(config, GridTrackerConfig):
            return GridTracker(config, self._empty_grid(), self._inserter, self.config.seed)
        return SurfelTracker(config)
