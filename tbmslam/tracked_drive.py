"""The drive so far, as it was tracked: the poses of all readings, the keyframes and the incidents."""

from array import array
from collections.abc import Callable

import numpy as np

from tbmslam.back_end import BackEnd
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.front_end import FrontEnd, Placement, make_tracker
from tbmslam.geometry.se2 import FloatArray
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.local_frame import LocalFrame
from tbmslam.monitoring.drive_monitor import DriveMonitor
from tbmslam.parallel.executor import Progress
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.tracking.keyframe_buffer import KeyframeBuffer
from tbmslam.tracking.tracked_keyframe import packed


class TrackedDrive:
    """Tracks one drive, reading by reading.

    `corrected` corrects each scan before it is used, and `finding` is the reason for it, for the user.
    """

    def __init__(
        self,
        config: SlamConfig,
        back_end: BackEnd,
        corrected: Callable[[LaserScan], LaserScan] | None = None,
        finding: str | None = None,
    ) -> None:
        self.monitor = DriveMonitor(config.blocked_beams, config.odometry_check)
        self.front_end = FrontEnd(config, make_tracker(config))
        self.buffer = KeyframeBuffer(config.forgetting)
        # Plain numbers, three for each pose, since a day has millions of poses.
        self.stamps, self._poses = array("d"), array("d")
        self.frame = LocalFrame()
        self._back_end, self._corrected, self.finding = back_end, corrected, finding

    def add(self, reading: Reading) -> Placement:
        """Register one reading and update the surfels."""
        self.monitor.reopen()
        if self._corrected is not None:
            reading = reading.with_scan(self._corrected(reading.scan))
        if not self.stamps:
            self.frame = LocalFrame.around(reading.T_odom_robot)
        reading = self.monitor.cleaned(self.frame.reading(reading))
        placement = self.front_end.place(reading)
        self.monitor.check(placement.scan, placement.match, placement.prior, began_anew=placement.began_anew)
        if self.front_end.is_keyframe(placement):
            self._forget_where_full()
            self.buffer.add(self.front_end.learn(placement, len(self.stamps)))
            self.monitor.note_keyframe(reading, len(self.stamps), placement.T_map_robot)
        self.stamps.append(placement.scan.stamp)
        self._poses.extend(placement.T_map_robot)
        return placement

    def poses(self) -> FloatArray:
        """Return the poses (N, 3) of the robot as they were tracked, in the near frame."""
        return np.array(self._poses).reshape(-1, 3)

    def keyframes(self, poses: FloatArray) -> Keyframes:
        """Return the keyframes with poses (N, 3) of the robot, without beams that are known to be blocked."""
        kept = self.monitor.cleared_keyframes(self.buffer.keyframes)
        return packed(kept, poses[[keyframe.index for keyframe in kept]].reshape(-1, 3))

    def _forget_where_full(self) -> None:
        """Remove redundant keyframes if there are too many; only closed loops tell which are redundant."""
        if self.buffer.is_full() and self._back_end.closes_loops:
            keyframes = self.keyframes(self.poses())
            drive = self._back_end.closed(self.buffer.keyframes, keyframes, Progress())
            if drive is not None:
                self.buffer.forget(drive.poses, drive.closures)
