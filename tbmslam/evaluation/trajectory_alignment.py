"""Two trajectories of one drive, laid onto each other."""

from dataclasses import dataclass

import numpy as np

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.pose_matching import matching_poses
from tbmslam.evaluation.rigid_fit import fit_rigid
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory


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
