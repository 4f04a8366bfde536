"""True trajectories: TUM files, and the MIT Stata Center's own `*.gt.laser.poses`, which are of the laser."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tbmslam.geometry.se2 import SE2, compose, wrap_angles
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.tum import TumError, pose_lines, read_tum
from tbmslam.sensing.laser_scan import FARTHEST_PLACE

Frame = Literal["robot", "laser"]
"""What a trajectory is of."""

_FIELDS = 4


@dataclass(frozen=True)
class ReferenceTrajectory:
    """Where a robot or its laser truly was.

    Parameters
    ----------
    trajectory
        The poses.
    frame
        What they are of.
    """

    trajectory: Trajectory
    frame: Frame

    def of_robot(self, T_robot_sensor: SE2) -> Trajectory:
        """Return where the robot was whose laser is mounted so."""
        if self.frame == "robot":
            return self.trajectory
        poses = compose(self.trajectory.poses, np.array(T_robot_sensor.inverse()))
        return replace(self.trajectory, poses=poses)


def read_reference(path: str | os.PathLike[str]) -> ReferenceTrajectory:
    """Read a true trajectory of either format, told apart by what the first line holds.

    The Stata Center's truth (M. Fallon et al., IJRR 2013) has lines `t, x, y, theta`: whole microseconds, metres,
    radians, of the laser. A TUM file is of the robot.

    Raises
    ------
    TumError
        The file cannot be read or a line is not a pose.
    """
    numbered = pose_lines(Path(path))
    if not numbered or "," not in numbered[0][1]:
        return ReferenceTrajectory(read_tum(path), "robot")
    values = np.array([_laser_pose(f"{path}:{number}", line) for number, line in numbered])
    poses = np.column_stack((values[:, 1:3], wrap_angles(values[:, 3])))
    return ReferenceTrajectory(Trajectory(values[:, 0].copy(), poses), "laser")


def _laser_pose(place: str, line: str) -> tuple[float, float, float, float]:
    """Return stamp [s], x, y [m] and heading [rad] of a line."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) != _FIELDS or not fields[0].isdecimal():
        raise TumError(f"{place}: is not 't, x, y, theta' with t in whole microseconds: give a file of such lines")
    try:
        x, y, theta = map(float, fields[1:])
    except ValueError as error:
        raise TumError(f"{place}: {str(error)[:120]}: leave the line out") from None
    if not (abs(x) <= FARTHEST_PLACE and abs(y) <= FARTHEST_PLACE and np.isfinite(theta)):
        raise TumError(f"{place}: is not finite, or more than {FARTHEST_PLACE:.0e} m away: leave the line out")
    return int(fields[0]) * 1e-6, x, y, theta
