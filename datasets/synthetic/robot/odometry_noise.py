"""Odometry that drifts as wheels do."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.geometry.trajectory import Trajectory


@dataclass(frozen=True)
class OdometryNoise:
    """The odometry motion model of Thrun, Burgard and Fox, "Probabilistic Robotics" (2005), table 5.6.

    Each motion between two samples is taken apart into a turn, a translation and another turn, and each of the three
    gets a normal error. The variances are in squares of the motion, so their effect depends on how far apart samples
    are: the presets are meant for the 50 Hz of `datasets.synthetic.robot.drives`.

    Parameters
    ----------
    alpha1
        Variance of a turn per squared turn.
    alpha2
        Variance of a turn per squared translation [rad^2/m^2].
    alpha3
        Variance of a translation per squared translation.
    alpha4
        Variance of a translation per squared turn [m^2/rad^2].
    """

    alpha1: float
    alpha2: float
    alpha3: float
    alpha4: float

    PRESETS: ClassVar[tuple[str, ...]] = ("none", "good", "poor")

    def __post_init__(self) -> None:
        """Check that no variance is negative."""
        for name in ("alpha1", "alpha2", "alpha3", "alpha4"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @classmethod
    def preset(cls, name: str) -> "OdometryNoise":
        """Return noise by name: `none`, `good` (some 0.5 m after 140 m indoors) or `poor` (some 3 m).

        Raises
        ------
        ValueError
            When there is no preset of that name.
        """
        presets = {
            "none": cls(0.0, 0.0, 0.0, 0.0),
            "good": cls(0.002, 1.2e-5, 0.02, 4e-5),
            "poor": cls(0.07, 7e-4, 0.05, 1.3e-3),
        }
        if name not in presets:
            raise ValueError(f"name must be one of {', '.join(cls.PRESETS)}, got {name!r}")
        return presets[name]

    def odometry(self, drive: Trajectory, rng: np.random.Generator) -> Trajectory:
        """Return the odometry of a drive, in an odometry frame that begins at the drive's first pose."""
        turn_before, forward, turn_after = _motions(drive.poses)
        # Table 5.6, lines 5 to 7; a normal error is subtracted there, which is the same as adding one.
        spread_before = np.sqrt(self.alpha1 * turn_before**2 + self.alpha2 * forward**2)
        spread_forward = np.sqrt(self.alpha3 * forward**2 + self.alpha4 * (turn_before**2 + turn_after**2))
        spread_after = np.sqrt(self.alpha1 * turn_after**2 + self.alpha2 * forward**2)
        errors = rng.standard_normal((3, len(forward)))
        turn_before = turn_before + errors[0] * spread_before
        forward = forward + errors[1] * spread_forward
        turn_after = turn_after + errors[2] * spread_after
        # Lines 8 to 10, all steps at once: headings add up, and so do the translations along them.
        headings = np.concatenate(([0.0], np.cumsum(turn_before + turn_after)))
        along = headings[:-1] + turn_before
        poses = np.zeros_like(drive.poses)
        poses[1:, 0] = np.cumsum(forward * np.cos(along))
        poses[1:, 1] = np.cumsum(forward * np.sin(along))
        poses[:, 2] = wrap_angles(headings)
        return Trajectory(drive.stamps, poses)


def _motions(poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return turn, translation, turn (N - 1,) between poses; a robot that reverses has a negative translation.

    Table 5.6, lines 2 to 4, without their half turn for reversing and their random direction for a turn in place.
    """
    steps = np.diff(poses[:, :2], axis=0)
    turns = wrap_angles(np.diff(poses[:, 2]))
    forward = np.hypot(steps[:, 0], steps[:, 1])
    before = wrap_angles(np.arctan2(steps[:, 1], steps[:, 0]) - poses[:-1, 2])
    reverses = np.abs(before) > np.pi / 2.0
    forward = np.where(reverses, -forward, forward)
    before = np.where(reverses, wrap_angles(before + np.pi), before)
    before = np.where(np.abs(forward) < 1e-6, 0.0, before)
    return before, forward, wrap_angles(turns - before)
