"""The SLAM of one robot, from readings to a map."""

import logging
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tbmslam.back_end import BackEnd, OptimisedDrive
from tbmslam.belief.grid import TbmGrid
from tbmslam.calibration.laser_check import fit_laser, laser_warnings
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.front_end import Placement
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import render
from tbmslam.map.tbm_map import TbmMap
from tbmslam.monitoring.drive_review import DriveReview, standing_warnings
from tbmslam.monitoring.incidents import Incidents
from tbmslam.parallel.executor import Progress
from tbmslam.reading_trial import ReadingTrial
from tbmslam.sensing.laser_scan import Corrections, Reading
from tbmslam.tracked_drive import TrackedDrive

logger = logging.getLogger(__name__)


class Slam:
    """Builds a map from readings.

    Parameters
    ----------
    config
        All parameters; see `tbmslam.configuration.slam_config.preset`.
    name
        The robot's name in the map.
    progress
        Receives the duration of finishing and its progress.
    start_stamp
        Time zero of all messages, such as the start of the whole recording; None for the first reading's stamp [s].
    corrections
        Corrections that were applied to the readings.

    Attributes
    ----------
    correction_m
        Largest correction of the robot's position by loop closures and adjustment [m]; 0 if no loop was closed. Known
        when the map is finished.
    """

    correction_m = 0.0

    def __init__(
        self,
        config: SlamConfig | None = None,
        name: str = "robot",
        progress: Progress | None = None,
        start_stamp: float | None = None,
        corrections: Corrections | None = None,
    ) -> None:
        self.config = config or SlamConfig()
        self.name = name
        self._progress = progress or Progress()
        self._start_stamp, self._corrections = start_stamp, corrections or Corrections()
        self._back_end = BackEnd(self.config)
        self._drive = TrackedDrive(self.config, self._back_end)
        self._trial: ReadingTrial | None = None

    @property
    def incidents(self) -> Incidents:
        """Problems of the drive with their times."""
        return self._drive.monitor.incidents

    @property
    def start_stamp(self) -> float:
        """Time zero of all messages [s]; 0 before the first reading if none was given."""
        if self._start_stamp is not None:
            return self._start_stamp
        return self._drive.stamps[0] if self._drive.stamps else 0.0

    def process(self, reading: Reading) -> SE2:
        """Register one reading, update the surfels, and return the robot's pose T_map_robot.

        Raises
        ------
        ValueError
            The reading holds impossible numbers, see `Reading.check`.
        """
        reading.check()
        if not self._drive.stamps:
            is_step_known = self._corrections.angle_step
            self._trial = ReadingTrial.of(reading, self.config, self._back_end, is_step_known)
        placement = self._drive.add(reading)
        if self._trial is not None:
            placement = self._tried(self._trial, reading, placement)
        return self._drive.frame.pose_there(placement.T_map_robot)

    def finish(self, provenance: Mapping[str, object] | None = None) -> TbmMap:
        """Close loops, adjust poses and wall lines, and render the map of all readings so far.

        The drive may continue and be finished again.
        """
        if self._trial is not None:
            self._replaced_by(self._trial)
        self._drive.monitor.reopen()
        tracked = self._drive.poses()
        keyframes = self._drive.keyframes(tracked)
        optimised = self._optimised(keyframes)
        poses = self._final_poses(tracked, optimised)
        trajectory = Trajectory(np.array(self._drive.stamps), poses)
        if optimised is not None:
            self._check_laser(keyframes, optimised)
        keyframes = replace(keyframes, poses=poses[keyframes.indices].reshape(-1, 3))
        self._review(trajectory, keyframes)
        self._drive.monitor.log(self.name, self.start_stamp)
        with self._progress.during("rendering"):
            grid = self._rendered(keyframes)
        counts = len(trajectory), len(keyframes)
        logger.info("%s: %d scans, %d keyframes, %.1f m", self.name, *counts, trajectory.driven())
        drive = Drive(self.name, trajectory, keyframes)
        if optimised is not None:
            closed, closings = optimised.closed_pairs(), optimised.closure_motions()
            drive = replace(drive, closures=closed, motions=optimised.motions, closure_motions=closings)
        return self._drive.frame.map_there(TbmMap(grid, (drive,), dict(provenance or {})))

    def _tried(self, trial: ReadingTrial, reading: Reading, placement: Placement) -> Placement:
        """Continue a trial with a reading; return its placement in the drive that is used from now on."""
        other = trial.observe(reading, placement)
        if not trial.is_decided():
            return placement
        self._trial = None
        return other if self._replaced_by(trial) else placement

    def _replaced_by(self, trial: ReadingTrial) -> bool:
        """Return whether the trial's drive fits better and replaces the current one."""
        if not trial.is_better():
            return False
        self._drive, self._trial = trial.rival, None
        return True

    def _optimised(self, keyframes: Keyframes) -> OptimisedDrive | None:
        """Return the drive after loop closures and adjustment; None without loop closing or a second keyframe."""
        drive = self._back_end.closed(self._drive.buffer.keyframes, keyframes, self._progress)
        return None if drive is None else self._back_end.adjusted(drive, self._progress)

    def _final_poses(self, tracked: FloatArray, optimised: OptimisedDrive | None) -> FloatArray:
        """Return the poses (N, 3) of the robot at all readings, by the tracked poses (N, 3)."""
        self.correction_m = 0.0
        if optimised is None:
            return tracked
        poses = self._drive.buffer.corrected(tracked, optimised.poses)
        if optimised.closures:  # without closures, the drift is unknown
            self.correction_m = float(np.hypot(*(poses - tracked)[:, :2].T).max(initial=0.0))
        return poses

    def _check_laser(self, keyframes: Keyframes, drive: OptimisedDrive) -> None:
        """Warn if other angles or ranges of the laser fit the walls better."""
        config = self.config
        if not config.laser_fit.enabled:
            return
        with self._progress.during("checking the laser"):
            errors = fit_laser(keyframes, drive.hits, drive.poses, config.laser_fit, config.adjustment)
        if errors is not None:
            doubts = laser_warnings(errors, keyframes, config.laser_check, self._corrections.range_offset)
            for subject, message in doubts.items():
                self._drive.monitor.warn_of_whole_drive(subject, message, self.start_stamp)

    def _review(self, trajectory: Trajectory, keyframes: Keyframes) -> None:
        """Check the whole drive, with keyframes at their final poses and as they were tracked, and warn."""
        config = self.config
        review = DriveReview(config.mount_check, config.odometry_check, self.start_stamp, self._corrections)
        warnings = review.warnings(trajectory, keyframes, self._drive.buffer.keyframes)
        if self._drive.finding is not None:
            self._drive.monitor.warn_of_whole_drive("reading", self._drive.finding, self.start_stamp)
        if "angles" in self._drive.monitor.whole_drive_warnings:  # wrong angles also rotate all of the view
            warnings = [warning for warning in warnings if warning.subject != "mount"]
        if config.tracker.kind == "surfels":  # other trackers draw every scan
            warnings += standing_warnings(trajectory, keyframes)
        self._drive.monitor.warn_at_end(warnings, self.start_stamp)

    def _rendered(self, keyframes: Keyframes) -> TbmGrid:
        """Return the grid of the tracker, or a grid of the keyframes at their final poses."""
        grid = self._drive.front_end.grid()
        return render([keyframes], self.config.map) if grid is None else grid
