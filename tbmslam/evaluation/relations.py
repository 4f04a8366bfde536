"""True relative poses between moments of a drive, and how far a trajectory is from them.

Source of the metric: Kuemmerle et al., "On measuring the accuracy of SLAM algorithms", 2009, eq. 3: only relative
motions are compared, so that an error is charged where it happened and not to all that follows.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.pose_matching import matching_stamps
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.sensing.laser_scan import FARTHEST_PLACE
from tbmslam.special_file import why_unreadable


class RelationsError(TbmSlamError):
    """A relations file that cannot be used."""


@dataclass(frozen=True)
class Relations:
    """True motions between pairs of moments.

    Parameters
    ----------
    stamps
        Moments (N, 2) [s]: from, to.
    motions
        Pose (N, 3) at the second moment in the frame of the first: x, y [m], theta [rad].
    """

    stamps: FloatArray
    motions: FloatArray


@dataclass(frozen=True)
class RelationErrors:
    """How far estimated motions are from the true ones.

    Parameters
    ----------
    translations_m, rotations_deg
        Absolute error (M,) of every relation that could be checked.
    checked
        Indices (M,) of these relations.
    pairs
        Indices (M, 2) of the estimated poses that each of them was checked at: from, to.
    unmatched
        Relations without an estimated pose at one of their moments.
    """

    translations_m: FloatArray
    rotations_deg: FloatArray
    checked: npt.NDArray[np.int64]
    pairs: npt.NDArray[np.int64]
    unmatched: int


def read_relations(path: Path) -> Relations:
    """Read lines ``t1 t2 x y z roll pitch yaw``; ``#`` begins a comment.

    Raises
    ------
    RelationsError
        When the file cannot be read or has other columns.
    """
    if why := why_unreadable(path):
        raise RelationsError(f"{path}: {why}: give a file of relations")
    try:
        with warnings.catch_warnings(action="ignore"):  # an empty file is an error below
            values = np.loadtxt(path, comments="#", ndmin=2, dtype=np.float64)
    except (OSError, ValueError) as error:
        raise RelationsError(f"{path}: cannot be read as relations (t1 t2 x y z roll pitch yaw): {error}") from None
    if values.shape[1:] != (8,) or not np.isfinite(values).all() or not len(values):
        raise RelationsError(f"{path}: expected lines of eight finite numbers t1 t2 x y z roll pitch yaw")
    if not np.abs(values[:, 2:4]).max() <= FARTHEST_PLACE:
        raise RelationsError(f"{path}: a relation is longer than {FARTHEST_PLACE:.0e} m: leave it out")
    return Relations(values[:, :2], values[:, [2, 3, 7]])


def relation_errors(relations: Relations, trajectory: Trajectory, tolerance: float = 1e-3) -> RelationErrors:
    """Compare a trajectory's relative motions with the true ones.

    Parameters
    ----------
    relations
        The truth.
    trajectory
        The estimate.
    tolerance
        How far a pose's stamp may be from a relation's [s].
    """
    indices = np.full(relations.stamps.shape, -1, dtype=np.int64)
    for end in (0, 1):
        found, relation = matching_stamps(trajectory.stamps, relations.stamps[:, end], tolerance)
        indices[relation, end] = found
    checked = np.flatnonzero((indices >= 0).all(axis=1))
    translations, rotations = np.empty(len(checked)), np.empty(len(checked))
    for number, k in enumerate(checked):
        estimated = trajectory.pose(indices[k, 0]).inverse() @ trajectory.pose(indices[k, 1])
        error = SE2.from_array(relations.motions[k]).inverse() @ estimated
        translations[number], rotations[number] = np.hypot(error.x, error.y), np.degrees(abs(error.theta))
    return RelationErrors(translations, rotations, checked, indices[checked], len(indices) - len(checked))
