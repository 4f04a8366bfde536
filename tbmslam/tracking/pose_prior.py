"""Where the robot probably is before its scan is looked at."""

from collections.abc import Callable
from typing import NamedTuple

from tbmslam.geometry.se2 import SE2
from tbmslam.tracking.odometry_noise import Deviations


class PosePrior(NamedTuple):
    """A prior on the robot's pose, of Student's t distribution.

    Parameters
    ----------
    mean
        T_map_robot: by odometry since the last keyframe or, without odometry, by the last motion.
    deviations
        Of the mean in its own frame, those of the last keyframe's pose and of the motion since then together; all zero
        for the first pose of a drive, which is where it is.
    motion
        Of the motion alone.
    start
        T_map_robot: where the search for the scan's place begins, by odometry since the last scan.
    coasting
        Returns T_map_robot where the robot would be if it had gone on as before: another start where odometry slips.
    jump
        How far the odometry stepped where no robot moves so fast, so that it was left out [m]; else 0.
    by_odometry
        Whether the mean comes from odometry.
    """

    mean: SE2
    deviations: Deviations
    motion: Deviations
    start: SE2
    coasting: Callable[[], SE2]
    jump: float = 0.0
    by_odometry: bool = False
