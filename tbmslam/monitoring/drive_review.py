"""Looks back at a whole drive: its speed, what determined its motion, the odometry's scale and the laser's mounting."""

import math
from collections.abc import Sequence

from tbmslam.calibration.mount_change import MountChange, mount_changes
from tbmslam.calibration.mount_check import MountCheckConfig, mount_doubt
from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes
from tbmslam.monitoring.impossible_speed import impossible_speed
from tbmslam.monitoring.incidents import EndWarning
from tbmslam.monitoring.odometry_check import OdometryCheckConfig, odometry_scale
from tbmslam.monitoring.undetermined_motion import undetermined_motion
from tbmslam.tracking.tracked_keyframe import TrackedKeyframe, odometry

_BEYOND_S = 0.1
"""Intervals are told in steps of it and exclude their end."""


class DriveReview:
    """Tells what is wrong with a drive as a whole.

    Parameters
    ----------
    mount, lengths
        When the laser's place and the odometry's lengths are worth a warning.
    started
        Stamp from which times are told [s].
    scale
        What the odometry's lengths were multiplied by.
    """

    def __init__(self, mount: MountCheckConfig, lengths: OdometryCheckConfig, started: float, scale: float) -> None:
        self._mount, self._lengths = mount, lengths
        self._started, self._scale = started, scale

    def warnings(
        self, trajectory: Trajectory, keyframes: Keyframes, tracked: Sequence[TrackedKeyframe]
    ) -> list[EndWarning]:
        """Return what is wrong with a drive, by its keyframes at their final poses and as they were tracked."""
        wheels = odometry(tracked)
        found = undetermined_motion(tracked).warnings()
        fast = impossible_speed(trajectory.stamps, trajectory.poses, keyframes.stamps, wheels)
        if fast is not None:
            found.append(EndWarning("speed", fast.warning(), fast.stamp, all_along=False))
        ratio = odometry_scale(tracked, wheels, self._lengths.scale, self._lengths.lengths)
        if ratio != 1.0:
            found.append(EndWarning("scale", _scaled(ratio, self._scale)))
        return found + self._of_mount(trajectory, keyframes, wheels)

    def _of_mount(self, trajectory: Trajectory, keyframes: Keyframes, wheels: FloatArray) -> list[EndWarning]:
        """Return what is wrong with the laser's place on the robot; where it changed, its mean says nothing."""
        if not self._mount.enabled or len(keyframes) < 2:
            return []
        changes = mount_changes(keyframes.stamps, wheels, keyframes.all_sensor_poses(), self._mount.angle)
        if changes:
            ends = [
                *(float(keyframes.stamps[change.keyframe]) for change in changes),
                float(trajectory.stamps[-1]) + _BEYOND_S,
            ]
            return [self._knocked(changes[: number + 1], ends, keyframes) for number in range(len(changes))]
        what = mount_doubt(keyframes, wheels, self._mount)
        return [EndWarning("mount", what)] if what else []

    def _knocked(self, changes: Sequence[MountChange], ends: Sequence[float], keyframes: Keyframes) -> EndWarning:
        """Return the warning of the last of some changes, with the stamps [s] at which the parts of the drive end."""
        number, turn = len(changes), math.degrees(changes[-1].turn)
        x, y, stated = keyframes.sensor_poses[0].tolist()
        yaw = math.remainder(stated + sum(change.turn for change in changes), math.tau)
        begin = ends[number - 2] - self._started if number > 1 else 0.0
        knock, end = ends[number - 1] - self._started, ends[number] - self._started
        what = (
            f"the laser turned by {abs(turn):.0f} degrees to the {'left' if turn > 0.0 else 'right'} on the robot: "
            f"make one robot of the drive before, by --interval {begin:.1f} {knock:.1f}, and one of the drive after, "
            f"by --interval {knock:.1f} {end:.1f} with --sensor-pose {x:.2f} {y:.2f} {math.degrees(yaw):.0f}"
        )
        return EndWarning("mount change", what, ends[number - 1], all_along=False)


def _scaled(ratio: float, scale: float) -> str:
    """Return what is said where scans go so many times as far as an odometry that was scaled before."""
    told = f"the scans go {_digits(ratio)} times as far as the odometry, one of them has a wrong scale"
    return f"{told}; where it is the odometry's, --odometry-scale {_digits(ratio * scale)} mends it"


def _digits(scale: float) -> str:
    """Return a scale in words, to a hundredth or two digits."""
    return f"{scale:.2f}" if scale >= 0.1 else f"{scale:.2g}"
