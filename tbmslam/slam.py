"""One robot: readings in, a map out."""

import logging
import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.belief.grid import TbmGrid
from tbmslam.calibration.laser_check import laser_doubts
from tbmslam.calibration.laser_fit import fit_laser
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.loop_closure.loop_closer import LoopCloser
from tbmslam.map.drive_motions import DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.local_frame import NearFrame
from tbmslam.map.rendering import render
from tbmslam.map.scan_hits import ScanHits
from tbmslam.map.scan_inserter import ScanInserter
from tbmslam.map.tbm_map import Drive, TbmMap
from tbmslam.monitoring.drive_monitor import DriveMonitor
from tbmslam.monitoring.drive_review import DriveReview
from tbmslam.optimisation.bundle_adjustment import adjust
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.parallel.progress import Watch
from tbmslam.related.particle_tracker import ParticleTracker, ParticleTrackerConfig
from tbmslam.related.tile_maps import TileMaps
from tbmslam.sensing.corrections import Corrections
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.sensing.sensor_model import beam_factors
from tbmslam.tracking.deskew import deskewed
from tbmslam.tracking.drive_memory import DriveMemory
from tbmslam.tracking.motion_model import MotionModel
from tbmslam.tracking.pose_prior import PosePrior
from tbmslam.tracking.scan_match import ScanMatch
from tbmslam.tracking.surfel_tracker import SurfelTracker, SurfelTrackerConfig
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, chain, motions, packed
from tbmslam.tracking.tracker import Tracker
from tbmslam.vinyslam.grid_tracker import GridTracker, GridTrackerConfig

logger = logging.getLogger(__name__)


class Slam:
    """Maps while it localises.

    Parameters
    ----------
    config
        Every parameter; see `tbmslam.configuration.slam_config.preset`.
    name
        The robot's name in the map.
    watch
        Who is told how long finishing takes and how far it is.
    started
        Stamp from which times are told, as that of the recording that the drive is a part of; None for the first
        reading's [s].
    corrections
        What was changed in the readings as they were read.

    Attributes
    ----------
    incidents
        What went wrong, and when.
    correction_m
        How far closing loops, and then adjusting drive and walls, moved the robot at the most; 0 where none was closed.
        Known when the map is finished [m].
    """

    correction_m = 0.0

    def __init__(
        self,
        config: SlamConfig | None = None,
        name: str = "robot",
        watch: Watch | None = None,
        started: float | None = None,
        corrections: Corrections | None = None,
    ) -> None:
        self.config = config or SlamConfig()
        self.name = name
        self._watch = watch or Watch()
        self._started, self._corrections = started, corrections or Corrections()
        self._motion = MotionModel(self.config.motion)
        self._inserter = ScanInserter(self.config.map.sensor_model, self.config.map.insertion)
        self._tracker = self._make_tracker()
        self._closer = self._make_closer()
        # Plain numbers, three for each pose: a day has millions.
        self._stamps, self._poses = array("d"), array("d")
        self._T_map_keyframe: SE2 | None = None
        self._frame = NearFrame()
        self._mount = SE2.identity(), SE2.identity()  # T_robot_sensor and its inverse
        self._closures = np.zeros((0, 2), dtype=np.int64)
        self._measured: DriveMotions | None = None
        self._monitor = DriveMonitor(self.config.blocked_beams, self.config.odometry_check)
        self.incidents = self._monitor.incidents
        self._part = DriveMemory(0, self.config.forgetting)

    @property
    def started(self) -> float:
        """Stamp from which times are told [s]; 0 before the first reading where nobody said."""
        if self._started is not None:
            return self._started
        return self._stamps[0] if self._stamps else 0.0

    def process(self, reading: Reading) -> SE2:
        """Place one reading, learn from it, and return the robot's pose T_map_robot.

        Raises
        ------
        ValueError
            It holds numbers that cannot be meant, see `Reading.check`.
        """
        reading.check()
        self._monitor.reopen()
        if not self._stamps:
            self._frame = NearFrame.around(reading.T_odom_robot)
        reading = self._monitor.cleaned(self._frame.reading(reading))
        prior = self._motion.predict(reading)
        T_robot_sensor, T_sensor_robot = self._mounted(reading)
        scan, match = self._placed(reading, prior)
        T_map_robot = match.T_map_sensor @ T_sensor_robot
        self._motion.correct(reading, T_map_robot)
        self._monitor.check(scan, match, prior)
        if self._tracker.is_novel(match) or self._has_moved_to(T_map_robot):
            self._tracker.learn(scan, match)
            self._keep(scan, match, prior, reading)
            self._motion.learn(prior, T_map_robot, match.information, T_robot_sensor)
            self._motion.begin_at_keyframe(reading, T_map_robot)
            self._T_map_keyframe = T_map_robot
            self._monitor.note_keyframe(reading, T_map_robot)
        self._stamps.append(scan.stamp)
        self._poses.extend(T_map_robot)
        return self._frame.pose_there(T_map_robot)

    def finish(self, provenance: Mapping[str, object] | None = None) -> TbmMap:
        """Close the loops, adjust drive and walls, render the map of everything processed so far and return it.

        The drive may go on after it, and be finished again.
        """
        self._monitor.reopen()
        part = self._part
        poses = np.array(self._poses).reshape(-1, 3)
        tracked = poses
        keyframes = self._packed(part, tracked)
        poses = self._close_loops(poses, part, keyframes)
        if len(self._closures):  # without, there was no drift that anybody knows of
            self.correction_m = float(np.hypot(*(poses - tracked)[:, :2].T).max(initial=0.0))
        trajectory = Trajectory(np.array(self._stamps), poses)
        chosen = [k.index for k in part.keyframes]
        keyframes = replace(keyframes, poses=poses[chosen].reshape(-1, 3))
        self._review(trajectory, keyframes, part.keyframes)
        self._monitor.log(self.name, self.started)
        with self._watch.during("rendering"):
            grid = self._rendered(keyframes)
        logger.info(
            "%s: %d scans, %d keyframes, %.1f m", self.name, len(trajectory), len(keyframes), trajectory.length()
        )
        drive = Drive(self.name, trajectory, keyframes, self._closures, self._measured)
        return self._frame.map_there(TbmMap(grid, (drive,), dict(provenance or {})))

    def _review(self, trajectory: Trajectory, keyframes: Keyframes, tracked: Sequence[TrackedKeyframe]) -> None:
        """Warn of what only the whole drive tells, with keyframes at their final poses and as they were tracked."""
        config, scale = self.config, self._corrections.odometry_scale
        review = DriveReview(config.mount_check, config.odometry_check, self.started, scale)
        warnings = review.warnings(trajectory, keyframes, tracked)
        if "angles" in self._monitor.whole_drive_warnings:  # which turn all of the view, too
            warnings = [warning for warning in warnings if warning.subject != "mount"]
        self._monitor.warn_at_end(warnings, self.started)

    def _mounted(self, reading: Reading) -> tuple[SE2, SE2]:
        """Return T_robot_sensor and T_sensor_robot; lasers hardly ever move on their robots."""
        if self._mount[0] is not reading.T_robot_sensor and self._mount[0] != reading.T_robot_sensor:
            self._mount = reading.T_robot_sensor, reading.T_robot_sensor.inverse()
        return self._mount

    def _placed(self, reading: Reading, prior: PosePrior) -> tuple[LaserScan, ScanMatch]:
        """Return the scan without the motion of the robot while the laser turned, and where the laser was."""
        T_robot_sensor, T_sensor_robot = self._mount
        scan, sweep = reading.scan, reading.scan.sweep() if self.config.deskew.enabled else 0.0
        if sweep > 0.0:
            scan = deskewed(scan, self._motion.motion_after(reading, sweep), T_robot_sensor, self.config.deskew)
        match = self._tracker.match(scan, prior, T_robot_sensor)
        if reading.T_odom_robot is None and sweep > 0.0:
            # Only the poses tell the motion then, and the motion of before would feed its error back into the next one.
            T_map_robot = match.T_map_sensor @ T_sensor_robot
            scan = deskewed(
                reading.scan,
                self._motion.motion_to(reading, T_map_robot, sweep),
                T_robot_sensor,
                self.config.deskew,
            )
            match = self._tracker.match(scan, prior._replace(start=T_map_robot), T_robot_sensor)
        return scan, match

    def _keep(self, scan: LaserScan, match: ScanMatch, prior: PosePrior, reading: Reading) -> None:
        """Keep a scan as a keyframe; once there are very many, forget those that show nothing new."""
        part = self._part
        if self._closer is not None and part.is_full():
            keyframes = self._packed(part, np.array(self._poses).reshape(-1, 3)[part.start :])
            steps = chain(motions(part.keyframes))
            part.forget(*self._closed(self._closer, part, self._hits_of(keyframes), steps, Watch()))
        mount, heading = reading.T_robot_sensor, prior.mean.theta
        deviations = self._motion.deviations_since_keyframe(prior)
        motion = match.trust * prior_information(deviations, heading, (*mount,)) if self._stamps else 1e8 * np.eye(3)
        part.add(TrackedKeyframe.of(len(self._stamps), scan, mount, match, motion, reading.T_odom_robot))

    def _packed(self, part: DriveMemory, poses: FloatArray) -> Keyframes:
        """Return the keyframes of a part with poses (N, 3) of the robot, without what is known to be wrong by now."""
        kept = part.keyframes
        if self._monitor.has_blocked_beams():
            kept = [self._cleared(keyframe) for keyframe in kept]
        return packed(kept, poses[[keyframe.index for keyframe in kept]].reshape(-1, 3))

    def _cleared(self, keyframe: TrackedKeyframe) -> TrackedKeyframe:
        scan = keyframe.scan
        cleared = self._monitor.cleared(scan)
        return keyframe if cleared is scan else keyframe.with_scan(cleared)

    def _close_loops(self, poses: FloatArray, part: DriveMemory, keyframes: Keyframes) -> FloatArray:
        """Return the poses (N, 3) of the robot after what it saw again was brought to coincide."""
        closed = self._tracker.revised_poses()
        if closed is None and self._closer is not None and len(keyframes) >= 2:
            scans = self._hits_of(keyframes)
            self._measured = motions(part.keyframes)
            steps = chain(self._measured)
            closed, closures = self._closed(self._closer, part, scans, steps, self._watch)
            closed = self._adjusted(closed, scans, steps, closures)
            self._check_laser(keyframes, closed, steps)
            self._closures = np.array([(edge.source, edge.target) for edge in closures], dtype=np.int64).reshape(-1, 2)
        return poses if closed is None else part.corrected(poses, closed)

    def _adjusted(
        self, poses: FloatArray, scans: ScanHits, steps: list[MotionEdge], closures: list[MotionEdge]
    ) -> FloatArray:
        """Return the poses (K, 3) of the laser at keyframes after all that they saw of each wall was laid together."""
        if not self.config.adjustment.enabled:
            return poses
        with self._watch.during("adjusting"):
            width = self.config.loop_closing.robust_width
            return adjust(poses, [scans], steps, closures, width, self.config.adjustment)

    def _check_laser(self, keyframes: Keyframes, poses: FloatArray, steps: list[MotionEdge]) -> None:
        """Note where walls fit better, at poses (K, 3) of the laser, if it is another than it is described."""
        if not self.config.laser_fit.enabled:
            return
        with self._watch.during("checking the laser"):
            errors = fit_laser(keyframes, poses, steps, self.config.laser_fit, self.config.adjustment)
        if errors is not None:
            offset = self._corrections.range_offset
            for about, what in laser_doubts(errors, keyframes, self.config.laser_check, offset).items():
                self._monitor.warn_of_whole_drive(about, what, self.started)

    def _hits_of(self, keyframes: Keyframes) -> ScanHits:
        return ScanHits.of(keyframes, self.config.loop_closing.submap.max_range)

    def _closed(
        self, closer: LoopCloser, part: DriveMemory, scans: ScanHits, steps: list[MotionEdge], watch: Watch
    ) -> tuple[FloatArray, list[MotionEdge]]:
        """Return the poses (K, 3) of the laser at keyframes after closing loops, and the closures."""
        tracked = np.array([k.match.T_map_sensor for k in part.keyframes])
        return closer.close(tracked, scans, steps, watch)

    def _rendered(self, keyframes: Keyframes) -> TbmGrid:
        """Return the grid that the tracker wrote, or else draw one from the keyframes at their final poses."""
        if self._tracker.grid is not None:
            return self._tracker.grid.to_tbm_grid(self.config.map.keep_conflict).cropped_to_known()
        return render([keyframes], self.config.map)

    def _empty_grid(self) -> EvidenceGrid:
        return EvidenceGrid(self.config.map.resolution, self.config.map.max_cells)

    def _has_moved_to(self, T_map_robot: SE2) -> bool:
        """Tell whether the robot is far enough from its last keyframe for a new one."""
        last, limits = self._T_map_keyframe, self.config.keyframes
        if last is None:
            return True
        distance = math.hypot(T_map_robot.x - last.x, T_map_robot.y - last.y)
        return distance >= limits.distance or abs(wrap_angle(T_map_robot.theta - last.theta)) >= limits.angle

    def _make_tracker(self) -> Tracker:
        config = self.config.tracker
        if isinstance(config, GridTrackerConfig):
            return GridTracker(config, self._empty_grid(), self._inserter, self.config.seed)
        if isinstance(config, ParticleTrackerConfig):
            cells = self.config.map
            maps = TileMaps(config.particles, cells.resolution, cells.max_cells)
            factors = beam_factors(cells.sensor_model, cells.resolution, scan_quality=1.0)
            return ParticleTracker(config, maps, factors, self.config.seed)
        return SurfelTracker(config)

    def _make_closer(self) -> LoopCloser | None:
        tracker, closing = self.config.tracker, self.config.loop_closing
        if not closing.enabled or not isinstance(tracker, SurfelTrackerConfig):
            return None
        return LoopCloser(closing, tracker.surfels)
