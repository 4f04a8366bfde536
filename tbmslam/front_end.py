"""The front end: estimates the pose of each scan, and makes keyframes of scans that show something new."""

import math
from typing import NamedTuple

import numpy as np

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.belief.grid import TbmGrid
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.map.rendering import ScanInserter
from tbmslam.related.viny_tracker import GridTracker, GridTrackerConfig
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracking.deskew import deskewed
from tbmslam.tracking.motion_model import MotionModel
from tbmslam.tracking.surfel_tracker import SurfelTracker
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe
from tbmslam.tracking.tracker import PosePrior, ScanMatch, Tracker


class Placement(NamedTuple):
    """A reading with its pose."""

    reading: Reading
    scan: LaserScan
    """Its scan, after compensation of the motion during the scan."""
    prior: PosePrior
    """The pose by odometry, with its noise."""
    match: ScanMatch
    """The pose by odometry and scan."""
    T_map_robot: SE2
    began_anew: bool = False
    """Whether the odometry began anew in a pause before this reading, by the scan."""


class FrontEnd:
    """Predicts motions, compensates the motion during a scan, registers scans, and chooses keyframes."""

    def __init__(self, config: SlamConfig, tracker: Tracker) -> None:
        self._motion = MotionModel(config.motion)
        self._tracker = tracker
        self._deskew, self._limits = config.deskew, config.keyframes
        self._keep_conflict = config.map.keep_conflict
        self._mount = SE2.identity(), SE2.identity()  # T_robot_sensor and its inverse
        self._T_map_keyframe: SE2 | None = None

    def place(self, reading: Reading) -> Placement:
        """Return the reading with the pose that maximises the posterior of odometry and scan."""
        prior = self._motion.predict(reading)
        T_robot_sensor, T_sensor_robot = self._mounted(reading)
        sweep = reading.scan.sweep() if self._deskew.enabled else 0.0
        scan = reading.scan
        if sweep > 0.0:
            scan = deskewed(scan, self._motion.motion_after(reading, sweep), T_robot_sensor, self._deskew)
        match = self._tracker.match(scan, prior, T_robot_sensor)
        if reading.T_odom_robot is None and sweep > 0.0:
            # Without odometry only poses determine the motion; the motion of the last scan would propagate its error.
            T_map_robot = match.T_map_sensor @ T_sensor_robot
            motion = self._motion.motion_to(reading, T_map_robot, sweep)
            scan = deskewed(reading.scan, motion, T_robot_sensor, self._deskew)
            match = self._tracker.match(scan, prior._replace(start=T_map_robot), T_robot_sensor)
        T_map_robot = match.T_map_sensor @ T_sensor_robot
        self._motion.correct(reading, T_map_robot, match.is_lost and not match.moved)
        return Placement(reading, scan, prior, match, T_map_robot, self._motion.began_anew)

    def is_keyframe(self, placement: Placement) -> bool:
        """Return whether a scan shows something new, or the robot is far enough from its last keyframe."""
        return self._tracker.is_novel(placement.match) or self._has_moved_to(placement.T_map_robot)

    def learn(self, placement: Placement, index: int) -> TrackedKeyframe:
        """Insert a scan into the tracker's map, learn the noise of the motion, and return the keyframe."""
        reading, scan, prior, match, T_map_robot, _ = placement
        self._tracker.learn(scan, match)
        motion = self._information_since_keyframe(placement) if index else np.zeros((3, 3))
        keyframe = TrackedKeyframe.of(index, scan, reading.T_robot_sensor, match, motion, reading.T_odom_robot)
        self._motion.learn(prior, T_map_robot, match.information, reading.T_robot_sensor)
        self._motion.begin_at_keyframe(reading, T_map_robot)
        self._T_map_keyframe = T_map_robot
        return keyframe

    def grid(self) -> TbmGrid | None:
        """Return the grid of a tracker that writes one, else None."""
        grid = self._tracker.grid
        return None if grid is None else grid.to_tbm_grid(self._keep_conflict).cropped_to_known()

    def _information_since_keyframe(self, placement: Placement) -> FloatArray:
        """Return the information (3, 3) of the odometry since the last keyframe."""
        deviations = self._motion.deviations_since_keyframe(placement.prior)
        mount, heading = (*placement.reading.T_robot_sensor,), placement.prior.mean.theta
        information = prior_information(deviations, heading, mount)
        information *= placement.match.trust
        return information

    def _mounted(self, reading: Reading) -> tuple[SE2, SE2]:
        """Return T_robot_sensor and T_sensor_robot; lasers hardly ever move on their robots."""
        if self._mount[0] is not reading.T_robot_sensor and self._mount[0] != reading.T_robot_sensor:
            self._mount = reading.T_robot_sensor, reading.T_robot_sensor.inverse()
        return self._mount

    def _has_moved_to(self, T_map_robot: SE2) -> bool:
        last, limits = self._T_map_keyframe, self._limits
        if last is None:
            return True
        distance = math.hypot(T_map_robot.x - last.x, T_map_robot.y - last.y)
        return distance >= limits.distance or abs(wrap_angle(T_map_robot.theta - last.theta)) >= limits.angle


def make_tracker(config: SlamConfig) -> Tracker:
    """Return the tracker that a configuration names: surfels, or vinySLAM's grid."""
    tracker, cells = config.tracker, config.map
    if isinstance(tracker, GridTrackerConfig):
        inserter = ScanInserter(cells.sensor_model, cells.insertion)
        return GridTracker(tracker, EvidenceGrid(cells.resolution, cells.max_cells), inserter, config.seed)
    return SurfelTracker(tracker)
