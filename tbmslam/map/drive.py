"""The drive of one robot: its trajectory, keyframes and measured motions, and their correction."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, IntArray, compose, interpolate, inverse
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.keyframes import Keyframes

_EIGENVALUES = 1e-12, 1e12
"""Limits of the eigenvalues of an information, for deviations of a micrometre and a kilometre."""


@dataclass(frozen=True, repr=False)
class DriveMotions:
    """Measured motions of the laser between keyframes, with their information.

    The optimised poses of a drive contain its own loop closures. A joint optimisation with other robots needs the
    measurements instead: if a loop closure bent a corridor, only they show that it was straight.
    """

    steps: FloatArray
    """Motions (S, 3): x [m], y [m], theta [rad] of the later laser as seen from the earlier."""
    informations: FloatArray
    """Inverse covariances (S, 3, 3) of an error in x, y [m] and theta [rad] in the later laser's frame."""

    def __post_init__(self) -> None:
        """Check the shapes and values of the arrays."""
        count = len(self.steps)
        if self.steps.shape != (count, 3) or self.informations.shape != (count, 3, 3):
            raise ValueError(
                f"steps and informations must have shapes (S, 3) and (S, 3, 3), got {self.steps.shape} and "
                f"{self.informations.shape}"
            )
        if not (np.isfinite(self.steps).all() and np.isfinite(self.informations).all()):
            raise ValueError("steps and informations must be finite")
        if not _are_informations(self.informations):
            least, most = _EIGENVALUES
            raise ValueError(
                f"informations must be symmetric and positive definite, with eigenvalues from {least:g} to {most:g}"
            )

    def __repr__(self) -> str:
        """Return one line: the number of steps."""
        return f"DriveMotions({len(self)} steps)"

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)


def _are_informations(matrices: FloatArray) -> bool:
    """Return whether matrices (S, 3, 3) are symmetric, with eigenvalues within the limits."""
    least, most = _EIGENVALUES
    if not np.allclose(matrices, np.swapaxes(matrices, 1, 2)) or (np.trace(matrices, axis1=1, axis2=2) >= most).any():
        return False
    try:
        np.linalg.cholesky(matrices - least * np.eye(3))  # in a fifth of the time of the eigenvalues
    except np.linalg.LinAlgError:
        return False
    return True


@dataclass(frozen=True)
class DriveLinks:
    """Loop closures between the drives of a map."""

    ends: IntArray
    """Ends (C, 4): a drive and its keyframe, and the drive and keyframe that were seen from there."""
    motions: DriveMotions
    """The second keyframes as seen from the first ones."""

    def __post_init__(self) -> None:
        """Check that every link has a motion."""
        if self.ends.shape != (len(self.motions), 4):
            raise ValueError(f"ends must have shape ({len(self.motions)}, 4), got {self.ends.shape}")

    def check(self, drives: Sequence["Drive"]) -> None:
        """Raise a `ValueError` unless all ends are keyframes of these drives."""
        counts = np.array([len(drive.keyframes) for drive in drives], dtype=np.int64)
        numbers, keyframes = self.ends.reshape(-1, 2).T
        if not np.all((numbers >= 0) & (numbers < len(counts))):
            raise ValueError(f"links must be between the {len(counts)} drives")
        if not np.all((keyframes >= 0) & (keyframes < counts[numbers])):
            raise ValueError("links must be between keyframes of the drives")

    def renumbered(self, first: int) -> "DriveLinks":
        """Return the links after that many other drives were put before theirs."""
        return replace(self, ends=self.ends + np.array([first, 0, first, 0]))

    @classmethod
    def joined(cls, parts: Sequence["DriveLinks"]) -> "DriveLinks | None":
        """Return all links; None if there are none."""
        if not any(len(part.ends) for part in parts):
            return None
        steps = np.concatenate([part.motions.steps for part in parts])
        informations = np.concatenate([part.motions.informations for part in parts])
        return cls(np.concatenate([part.ends for part in parts]), DriveMotions(steps, informations))


@dataclass(frozen=True, repr=False)
class Drive:
    """The drive of a robot through the map."""

    name: str
    trajectory: Trajectory
    """Poses of the robot in the map, one for every scan that was used."""
    keyframes: Keyframes
    """Scans at poses of the trajectory, from which the grid can be rendered again. The trajectory may be unknown, with
    no poses at all."""
    closures: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    """Indices (C, 2) of keyframes between which a loop was closed: the earlier visit and the later one."""
    motions: DriveMotions | None = None
    """Motions between successive keyframes by odometry and scans; None if only the poses are known."""
    closure_motions: DriveMotions | None = None
    """Motions of the closures by scans, from the earlier to the later keyframe; None if only pairs are known."""

    def __post_init__(self) -> None:
        """Check that keyframes are on the trajectory, and that closures and motions are between keyframes."""
        indices, poses = self.keyframes.indices, len(self.trajectory)
        if poses and len(indices) and indices[-1] >= poses:  # they rise
            raise ValueError(f"keyframes must be among the {poses} poses of the trajectory, got index {indices[-1]}")
        if self.closures.ndim != 2 or self.closures.shape[1] != 2:
            raise ValueError(f"closures must have shape (C, 2), got {self.closures.shape}")
        if len(self.closures) and not 0 <= self.closures.min() <= self.closures.max() < len(self.keyframes):
            raise ValueError(f"closures must be between the {len(self.keyframes)} keyframes")
        steps = max(len(self.keyframes) - 1, 0)
        if self.motions is not None and len(self.motions) != steps:
            raise ValueError(
                f"there must be one motion less than the {len(self.keyframes)} keyframes, got {len(self.motions)}"
            )
        if self.closure_motions is not None and len(self.closure_motions) != len(self.closures):
            raise ValueError(
                f"there must be one motion for each of the {len(self.closures)} closures, "
                f"got {len(self.closure_motions)}"
            )

    def __repr__(self) -> str:
        """Return one line: the robot's name and the sizes of the drive."""
        return f"Drive({self.name!r}, {len(self.trajectory)} poses, {len(self.keyframes)} keyframes)"

    def transformed(self, T_new_old: SE2) -> "Drive":
        """Return the same drive in another frame."""
        return replace(
            self, trajectory=self.trajectory.transformed(T_new_old), keyframes=self.keyframes.transformed(T_new_old)
        )


def spread_corrections(poses: FloatArray, anchors: IntArray, anchor_poses: FloatArray) -> FloatArray:
    """Return the poses (N, 3) of a drive after those at rising indices `anchors` (K,) moved to `anchor_poses` (K, 3).

    Poses between two anchors follow both.
    """
    if len(anchors) == 0:
        return poses.copy()
    corrections = compose(anchor_poses, inverse(poses[anchors]))
    after = np.searchsorted(anchors, np.arange(len(poses)), side="right")
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(anchors) - 1)
    spans = anchors[after] - anchors[before]
    shares = np.where(spans > 0, (np.arange(len(poses)) - anchors[before]) / np.maximum(spans, 1), 0.0)
    between = interpolate(corrections[before], corrections[after], shares)
    moved = compose(between, poses)
    moved[anchors] = anchor_poses  # to the last digit
    return moved


def with_keyframes_at(drive: Drive, poses: FloatArray) -> Drive:
    """Return a drive with other robot poses (K, 3) at its keyframes, and a trajectory that follows them."""
    trajectory, keyframes = drive.trajectory, drive.keyframes
    moved = replace(drive, keyframes=replace(keyframes, poses=poses))
    if len(trajectory) == 0:
        return moved
    corrected = spread_corrections(trajectory.poses, keyframes.indices, poses)
    return replace(moved, trajectory=Trajectory(trajectory.stamps, corrected))
