"""The back end: loop closures and bundle adjustment correct the keyframes of a whole drive."""

from collections.abc import Sequence
from typing import NamedTuple

from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.geometry.se2 import FloatArray, IntArray, laid_out
from tbmslam.loop_closure.closure_graph import nodes_of
from tbmslam.loop_closure.loop_closer import LoopCloser
from tbmslam.loop_closure.odometry_headings import OdometryHeadings
from tbmslam.map.drive import DriveMotions, spread_corrections
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.bundle_adjustment import adjust
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge
from tbmslam.parallel.executor import Progress
from tbmslam.tracking.surfel_tracker import SurfelTrackerConfig
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, motions, poses_of_sensor


class OptimisedDrive(NamedTuple):
    """A drive after optimisation."""

    poses: FloatArray
    """(K, 3), of the laser at keyframes."""
    motions: DriveMotions
    """Motions between keyframes by odometry and scans."""
    chain: MotionChain
    """The motions as a part of a pose graph."""
    closures: list[MotionEdge]
    hits: ScanHits

    def closed_pairs(self) -> IntArray:
        """Return the keyframes (C, 2) between which loops were closed."""
        return EdgeArrays.of(self.closures).ends

    def closure_motions(self) -> DriveMotions:
        """Return the motions of the closures."""
        _, steps, informations = EdgeArrays.of(self.closures)
        return DriveMotions(steps, informations)


class BackEnd:
    """Closes loops and adjusts poses and walls."""

    def __init__(self, config: SlamConfig) -> None:
        self._closing, self._adjustment = config.loop_closing, config.adjustment
        self._closer: LoopCloser | None = None
        if config.loop_closing.enabled and isinstance(config.tracker, SurfelTrackerConfig):
            self._closer = LoopCloser(config.loop_closing, config.tracker.surfels)

    @property
    def closes_loops(self) -> bool:
        """Whether it closes loops: not if that is disabled, nor for the grids of other trackers."""
        return self._closer is not None

    def closed(
        self, tracked: Sequence[TrackedKeyframe], keyframes: Keyframes, progress: Progress
    ) -> OptimisedDrive | None:
        """Return the drive after closing loops; None if it closes no loops or there are fewer than two keyframes."""
        if self._closer is None or len(keyframes) < 2:
            return None
        measured = motions(tracked)
        chain = MotionChain(measured.steps, measured.informations)
        hits = ScanHits.of(keyframes, self._closing.submap.max_range)
        poses, closures = self._closer.close(poses_of_sensor(tracked), hits, chain, progress)
        drive = OptimisedDrive(poses, measured, chain, closures, hits)
        return self._with_odometry_headings(drive, OdometryHeadings.of(tracked))

    def _with_odometry_headings(self, drive: OptimisedDrive, headings: OdometryHeadings) -> OptimisedDrive:
        """Fuse the headings of a drive with those by odometry, if these drift less than their noise predicts.

        The closures stay as they are: a new search would take as long as the first.
        """
        measured = headings.fused(drive.motions, drive.closures)
        if measured is None:
            return drive
        chain, nodes = MotionChain(measured.steps, measured.informations), nodes_of(drive.closures)
        width = self._closing.graph.robust_width
        solved = optimise(drive.poses, chain.between(nodes), drive.closures, width, nodes)
        poses = spread_corrections(laid_out(drive.poses[0], measured.steps), nodes, solved)
        return drive._replace(poses=poses, motions=measured, chain=chain)

    def adjusted(self, drive: OptimisedDrive, progress: Progress) -> OptimisedDrive:
        """Return the drive after poses and wall lines were optimised together."""
        if not self._adjustment.enabled:
            return drive
        with progress.during("adjusting"):
            width = self._closing.graph.robust_width
            poses = adjust(drive.poses, [drive.hits], [drive.chain], drive.closures, width, self._adjustment)
        return drive._replace(poses=poses)
