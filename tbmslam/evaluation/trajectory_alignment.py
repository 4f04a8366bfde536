"""Two trajectories of one drive, laid onto each other."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.pose_matching import matching_poses
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory


def fit_rigid(target: npt.ArrayLike, source: npt.ArrayLike) -> tuple[SE2, float]:
    """Return the rigid motion T_target_source with the least squared distance, and the best fitting scale.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991, in the plane and
    with the scale reported, not applied. The scale of coincident points is nan.

    Parameters
    ----------
    target, source
        Points (N, 2) that belong together [m].
    """
    target, source = np.asarray(target, dtype=np.float64), np.asarray(source, dtype=np.float64)
    target_mean, source_mean = target.mean(axis=0), source.mean(axis=0)
    p, q = target - target_mean, source - source_mean
    dot, cross = float((p * q).sum()), float((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum())
    rotation = SE2(0.0, 0.0, float(np.arctan2(cross, dot)))
    spread = float((q**2).sum())
    x, y = target_mean - rotation.apply(source_mean)
    return SE2(float(x), float(y), rotation.theta), float(np.hypot(dot, cross) / spread) if spread > 0.0 else np.nan


class TrajectoryAlignmentError(TbmSlamError):
    """The trajectories have too little in common."""


@dataclass(frozen=True)
class TrajectoryAlignment:
    """How an estimated trajectory lies on a reference.

    Parameters
    ----------
    T_reference_estimate
        Carries the estimate's frame to the reference's.
    errors_m
        Distance (M,) left at every pose that both have [m].
    """

    T_reference_estimate: SE2
    errors_m: FloatArray

    @property
    def ate_m(self) -> float:
        """Absolute trajectory error: root mean square of the distances left [m]."""
        return float(np.sqrt(np.mean(self.errors_m**2)))


def align_trajectories(
    reference: Trajectory, estimate: Trajectory, max_stamp_difference: float = 0.01
) -> TrajectoryAlignment:
    """Lay an estimate onto a reference by the rigid motion that leaves the smallest squared distances.

    Poses belong together when their stamps differ by no more than `max_stamp_difference` seconds, see
    `matching_poses`.

    Raises
    ------
    TrajectoryAlignmentError
        When fewer than two poses belong together.
    """
    i, j = matching_poses(reference.stamps, estimate.stamps, max_stamp_difference)
    if len(i) < 2:
        raise TrajectoryAlignmentError(
            f"only {len(i)} of {len(estimate)} poses have a partner within {max_stamp_difference:g} s in the "
            "reference: check that both trajectories are of the same drive and clock"
        )
    target, source = reference.poses[i, :2], estimate.poses[j, :2]
    T_reference_estimate, _ = fit_rigid(target, source)
    errors = np.hypot(*(T_reference_estimate.apply(source) - target).T)
    return TrajectoryAlignment(T_reference_estimate, errors)
