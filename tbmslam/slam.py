"""One robot: readings in, a map out."""

import logging
import math
from array import array
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tbmslam.adjustment.laser_fit import fit_laser
from tbmslam.adjustment.surface_adjustment import adjust
from tbmslam.config import SlamConfig
from tbmslam.corrections import Corrections
from tbmslam.drive_motions import DriveMotions
from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.grid import TbmGrid
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.left_out import left_out_said
from tbmslam.loops.loop_closing import LoopCloser
from tbmslam.mapping import ScanInserter
from tbmslam.monitoring.drive_monitor import DriveMonitor
from tbmslam.monitoring.laser_check import laser_doubts
from tbmslam.monitoring.mount_check import mount_doubt
from tbmslam.near_frame import NearFrame
from tbmslam.pose_graph import MotionEdge
from tbmslam.rendering import render
from tbmslam.scan_hits import ScanHits
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2, FloatArray, wrap_angle
from tbmslam.sensor_model import beam_factors
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.tracking.deskew import deskewed
from tbmslam.tracking.drive_memory import DriveMemory
from tbmslam.tracking.grid_tracker import GridTracker, GridTrackerConfig
from tbmslam.tracking.motion import MotionModel, Prediction
from tbmslam.tracking.particle_tracker import ParticleTracker, ParticleTrackerConfig
from tbmslam.tracking.surfel_tracker import SurfelTracker, SurfelTrackerConfig
from tbmslam.tracking.tile_maps import TileMaps
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, chain, motions, odometry, packed
from tbmslam.tracking.tracker import Tracker
from tbmslam.trajectory import Trajectory
from tbmslam.watch import Watch

logger = logging.getLogger(__name__)

_HELD_BACK_SAID = (
    "what goes along holds the robot back, the odometry is believed instead; where walls look alike, the way may "
    "still come out too short"
)
_HELD_BACK = 0.1  # worth telling [m]


class Slam:
    """Maps while it localises.

    Parameters
    ----------
    config
        Every parameter; see `tbmslam.config.preset`.
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
        self._T_odom_keyframe: SE2 | None = None  # None where the odometry since then is not believed
        self._variances = [0.0, 0.0, 0.0]
        self._frame = NearFrame()
        self._mount = SE2.identity(), SE2.identity()  # T_robot_sensor and its inverse
        self._closures = np.zeros((0, 2), dtype=np.int64)
        self._measured: DriveMotions | None = None
        continuity = self.config.continuity
        if not isinstance(self.config.tracker, SurfelTrackerConfig):  # whose scores alone tell that the robot got lost
            continuity = continuity.model_copy(update={"enabled": False})
        self._monitor = DriveMonitor(continuity, self.config.blocked_beams, self.config.odometry_check)
        self.incidents = self._monitor.incidents
        self._parts = [DriveMemory(0, self.config.forgetting)]  # each hangs together

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
        prediction = self._motion.predict(reading)
        T_robot_sensor, T_sensor_robot = self._mounted(reading)
        guess = prediction.T_map_robot @ T_robot_sensor
        scan, match = self._placed(reading, prediction, guess)
        match = self._checked(scan, match, prediction, guess)
        T_map_robot = match.T_map_sensor @ T_sensor_robot
        is_keyframe = (
            self._tracker.is_novel(match) or self._has_moved_to(T_map_robot) or self._may_be_held_back(reading)
        )
        if is_keyframe:
            match = self._settled(scan, match, reading)
            T_map_robot = match.T_map_sensor @ T_sensor_robot
        self._motion.correct(reading, T_map_robot)
        # On plain numbers: three of them take NumPy ten times as long.
        for axis, deviation in enumerate(prediction.deviations.tolist()):
            self._variances[axis] += deviation * deviation
        if is_keyframe:
            self._tracker.learn(scan, match)
            if not self._tracker.sees_walkers:  # who may hold the robot back, and the odometry is right
                self._motion.learn(prediction, guess, match.T_map_sensor, match.information)
            self._keep(scan, match, reading)
            self._T_map_keyframe, self._T_odom_keyframe = T_map_robot, reading.T_odom_robot
            self._variances = [0.0, 0.0, 0.0]
            self._monitor.note_keyframe(reading, T_map_robot)
        self._stamps.append(scan.stamp)
        self._poses.extend(T_map_robot)
        self._cut(self._monitor.came_out_elsewhere(scan, match.T_map_sensor, T_map_robot, learnt=is_keyframe))
        return self._frame.pose_there(T_map_robot)

    def finish(self, provenance: Mapping[str, object] | None = None) -> TbmMap:
        """Close the loops, adjust drive and walls, render the map of everything processed so far and return it.

        Where the robot got lost, it is the map of the longest part of the drive that hangs together. The drive may go
        on after it, and be finished again.
        """
        self._monitor.reopen()
        self._cut(self._monitor.ended_elsewhere())
        readings, part = self._longest_part()
        poses = np.array(self._poses).reshape(-1, 3)[readings]
        tracked = poses
        keyframes = self._packed(part, tracked)
        poses = self._close_loops(poses, part, keyframes)
        if len(self._closures):  # without, there was no drift that anybody knows of
            self.correction_m = float(np.hypot(*(poses - tracked)[:, :2].T).max(initial=0.0))
        trajectory = Trajectory(np.array(self._stamps[readings]), poses)
        chosen = [k.index for k in part.keyframes]
        keyframes = replace(keyframes, poses=poses[chosen].reshape(-1, 3))
        what = mount_doubt(keyframes, odometry(part.keyframes), self.config.mount_check)
        if what and "angles" not in self._monitor.said_all_along:  # which turn all of the view, too
            self._monitor.note_all_along("mount", what, self.started)
        self._monitor.tell(self.name, self.started, self._corrections.odometry_scale)
        with self._watch.during("rendering"):
            grid = self._rendered(keyframes)
        logger.info(
            "%s: %d scans, %d keyframes, %.1f m", self.name, len(trajectory), len(keyframes), trajectory.length()
        )
        drive = Drive(self.name, trajectory, keyframes, self._closures, self._measured)
        return self._frame.map_there(TbmMap(grid, (drive,), dict(provenance or {})))

    def _mounted(self, reading: Reading) -> tuple[SE2, SE2]:
        """Return T_robot_sensor and T_sensor_robot; lasers hardly ever move on their robots."""
        if self._mount[0] != reading.T_robot_sensor:
            self._mount = reading.T_robot_sensor, reading.T_robot_sensor.inverse()
        return self._mount

    def _placed(self, reading: Reading, prediction: Prediction, guess: SE2) -> tuple[LaserScan, ScanMatch]:
        """Return the scan without the motion of the robot while the laser turned, and where the laser was."""
        (T_robot_sensor, T_sensor_robot), deviations = self._mount, prediction.deviations
        scan, sweep = reading.scan, reading.scan.sweep() if self.config.deskew.enabled else 0.0
        if sweep > 0.0:
            scan = deskewed(scan, self._motion.motion_after(reading, sweep), T_robot_sensor, self.config.deskew)

        def other_guess() -> SE2:
            return self._motion.alternative(reading, prediction.T_map_robot) @ T_robot_sensor

        match = self._tracker.match(scan, guess, deviations, other_guess)
        if reading.T_odom_robot is None and sweep > 0.0:
            # Only the poses tell the motion then, and the motion of before would feed its error back into the next one.
            T_robot_swept = self._motion.motion_to(reading, match.T_map_sensor @ T_sensor_robot, sweep)
            scan = deskewed(reading.scan, T_robot_swept, T_robot_sensor, self.config.deskew)
            match = self._tracker.match(scan, match.T_map_sensor, deviations, other_guess)
        return scan, match

    def _settled(self, scan: LaserScan, match: ScanMatch, reading: Reading) -> ScanMatch:
        """Return where a keyframe was taken, which what walks along must not decide."""
        T_map_before, T_odom_before, T_odom_robot = self._T_map_keyframe, self._T_odom_keyframe, reading.T_odom_robot
        if T_map_before is None or T_odom_before is None or T_odom_robot is None or not match.moved:
            return self._tracker.settled(scan, match, None)

        def since() -> tuple[SE2, FloatArray]:
            by_odometry = self._motion.by_odometry(T_odom_before, T_odom_robot, T_map_before)
            return by_odometry.T_map_robot @ reading.T_robot_sensor, by_odometry.deviations

        settled = self._tracker.settled(scan, match, since)
        moved = match.T_map_sensor.to(settled.T_map_sensor)
        # Where scans went too far, as in a fast turn, the odometry brings the robot back, and nobody held it.
        way, way_found = (
            T_map_before.to(T_map_sensor @ reading.T_robot_sensor.inverse())
            for T_map_sensor in (settled.T_map_sensor, match.T_map_sensor)
        )
        is_farther = math.hypot(way.x, way.y) > math.hypot(way_found.x, way_found.y)
        if is_farther and math.hypot(moved.x, moved.y) > _HELD_BACK:
            self.incidents.add(scan.stamp, _HELD_BACK_SAID)
        return settled

    def _checked(self, scan: LaserScan, match: ScanMatch, prediction: Prediction, guess: SE2) -> ScanMatch:
        """Return where the laser was; where it got lost, a new part of the drive begins."""
        if prediction.is_frozen or prediction.jump:
            self._T_odom_keyframe = None
        if prediction.is_frozen:
            self.incidents.add(
                scan.stamp, "the odometry stands still while the robot moves, scans alone tell the motion"
            )
        found = self._monitor.checked(scan, match, guess, prediction.jump)
        if found is None:
            self._T_odom_keyframe = None
            self._tracker = self._make_tracker()
            self._parts.append(DriveMemory(len(self._stamps), self.config.forgetting))
            found = ScanMatch(guess, 0.0, moved=False)
        return found

    def _cut(self, stamp: float | None) -> None:
        """Begin a new part of the drive at a stamp that lies a while back, if there is one."""
        if stamp is None:
            return
        part, begin = self._parts[-1], len(self._stamps) - 1
        # Stamps may have stepped back since: where they last passed it.
        while begin - 1 > part.start and not self._stamps[begin - 1] < stamp <= self._stamps[begin]:
            begin -= 1
        self._parts.append(part.split(begin))
        self._tracker = self._make_tracker()
        for keyframe in self._parts[-1].keyframes:
            self._tracker.learn(keyframe.scan, keyframe.match)

    def _keep(self, scan: LaserScan, match: ScanMatch, reading: Reading) -> None:
        """Keep a scan as a keyframe; once there are very many, forget those that show nothing new."""
        part = self._parts[-1]
        if self._closer is not None and part.is_full():
            keyframes = self._packed(part, np.array(self._poses).reshape(-1, 3)[part.start :])
            part.forget(*self._closed(self._closer, part, self._hits_of(keyframes), Watch()))
        index, variances = len(self._stamps) - part.start, np.array(self._variances)
        part.add(TrackedKeyframe.of(index, scan, reading.T_robot_sensor, match, variances, reading.T_odom_robot))

    def _longest_part(self) -> tuple[slice, DriveMemory]:
        """Return the readings of the part with the most keyframes, and its memory."""
        ends = [*(part.start for part in self._parts[1:]), len(self._stamps)]
        longest = max(range(len(self._parts)), key=lambda number: len(self._parts[number]))
        for number, (part, end) in enumerate(zip(self._parts, ends, strict=True)):
            if number != longest:
                self._leave_out(part.start, end)
        return slice(self._parts[longest].start, ends[longest]), self._parts[longest]

    def _packed(self, part: DriveMemory, poses: FloatArray) -> Keyframes:
        """Return the keyframes of a part with poses (N, 3) of the robot, without what is known to be wrong by now."""
        kept = part.keyframes
        if self._monitor.knows_blocked_beams():
            kept = [self._cleared(keyframe) for keyframe in kept]
        return packed(kept, poses[[keyframe.index for keyframe in kept]].reshape(-1, 3))

    def _cleared(self, keyframe: TrackedKeyframe) -> TrackedKeyframe:
        scan = keyframe.scan
        cleared = self._monitor.cleared(scan)
        return keyframe if cleared is scan else keyframe.with_scan(cleared)

    def _leave_out(self, begin: int, end: int) -> None:
        """Note that a part of the drive is not in the map."""
        since, until = self._stamps[begin], self._stamps[end - 1]
        what = left_out_said(np.array(self._stamps), begin, end, self.started)
        self.incidents.conclude(since, what, max(until - since, 0.0))

    def _close_loops(self, poses: FloatArray, part: DriveMemory, keyframes: Keyframes) -> FloatArray:
        """Return the poses (N, 3) of the robot after what it saw again was brought to coincide."""
        closed = self._tracker.revised_poses()
        if closed is None and self._closer is not None and len(keyframes) >= 2:
            scans = self._hits_of(keyframes)
            closed, closures = self._closed(self._closer, part, scans, self._watch)
            self._measured = motions(part.keyframes)
            steps = chain(self._measured)
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
                self._monitor.note_all_along(about, what, self.started)

    def _hits_of(self, keyframes: Keyframes) -> ScanHits:
        return ScanHits.of(keyframes, self.config.loop_closing.submap.max_range)

    def _closed(
        self, closer: LoopCloser, part: DriveMemory, scans: ScanHits, watch: Watch
    ) -> tuple[FloatArray, list[MotionEdge]]:
        """Return the poses (K, 3) of the laser at keyframes after closing loops, and the closures."""
        tracked = np.array([k.match.T_map_sensor for k in part.keyframes])
        return closer.close(tracked, scans, chain(motions(part.keyframes)), watch)

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

    def _may_be_held_back(self, reading: Reading) -> bool:
        """Tell whether the odometry has gone twice as far as makes a keyframe, though the scans have not gone so far.

        Only at keyframes the tracker is asked whom to believe; without one, people could hold a robot back for long.
        """
        before, now = self._T_odom_keyframe, reading.T_odom_robot
        if before is None or now is None or not isinstance(self.config.tracker, SurfelTrackerConfig):
            return False
        return math.hypot(now.x - before.x, now.y - before.y) >= 2.0 * self.config.keyframes.distance

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
