"""True relative poses between times of a drive, and the errors of a trajectory in them.

Poses of two trajectories are matched by their stamps, also where the clock steps back.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.sensing.laser_scan import FARTHEST_PLACE
from tbmslam.special_file import why_unreadable

_MOST_LIKE = 64
"""Number of poses with similar stamps that are considered; all poses have one stamp if the clock stands still."""

_Cost = tuple[int, float]


def matching_stamps(
    first: FloatArray, second: FloatArray, tolerance: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return indices into stamps (N,), (M,), in any order: those of the first nearest to each of the second.

    Stamps of the second without one of the first within the tolerance are left out.
    """
    if not len(first) or not len(second):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    order = np.argsort(first, kind="stable")
    ordered = first[order]
    after = np.searchsorted(ordered, second)
    left, right = np.clip(after - 1, 0, len(first) - 1), np.clip(after, 0, len(first) - 1)
    nearest = np.where(np.abs(ordered[left] - second) <= np.abs(ordered[right] - second), left, right)
    matched = np.flatnonzero(np.abs(ordered[nearest] - second) <= tolerance)
    return order[nearest[matched]], matched


def matching_poses(
    first: FloatArray, second: FloatArray, tolerance: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return indices of matching stamps (N,), (M,) of two trajectories, both in the order of the recording [s].

    If the stamps of the first step back, several of its poses may have similar stamps. Stamps rise within runs, from
    one step back to the next. Matches continue in a run of the first trajectory as long as the second continues in its
    own run, and change to a later run with it. Of equals, the nearest stamp is taken, at most `tolerance` away [s].
    """
    if len(first) < 2 or (np.diff(first) > 0.0).all():
        return matching_stamps(first, second, tolerance)
    like = _alike(first, second, tolerance)
    matched = np.flatnonzero([len(candidates) > 0 for candidates in like])
    costs: list[list[_Cost]] = []
    origins: list[list[int]] = []
    runs, own_runs = _runs(first).tolist(), _runs(second).tolist()
    for number, index in enumerate(matched.tolist()):
        before = int(matched[number - 1]) if number else index
        passed = own_runs[index] - own_runs[before]
        costs.append([])
        origins.append([])
        for candidate in like[index].tolist():
            paths = (
                [
                    (cost[0] + abs(runs[candidate] - runs[other] - passed), cost[1], origin)
                    for origin, (cost, other) in enumerate(zip(costs[-2], like[before].tolist(), strict=True))
                ]
                if number
                else [(0, 0.0, 0)]
            )
            breaks, apart, origin = min(paths)
            costs[-1].append((breaks, apart + abs(float(first[candidate] - second[index]))))
            origins[-1].append(origin)
    return _traced(like, matched, costs, origins), matched


def _runs(stamps: FloatArray) -> npt.NDArray[np.int64]:
    """Return the number of the run of each stamp (N,); stamps increase within a run."""
    return np.concatenate(([0], np.cumsum(np.diff(stamps) <= 0.0)))[: len(stamps)]


def _alike(first: FloatArray, second: FloatArray, tolerance: float) -> list[npt.NDArray[np.intp]]:
    """Return for each of the second stamps the indices of the first that it may belong to, the nearest of each run."""
    order, runs = np.argsort(first, kind="stable"), _runs(first)
    ordered = first[order]
    middle = np.searchsorted(ordered, second)
    begins = np.maximum(np.searchsorted(ordered, second - tolerance, side="left"), middle - _MOST_LIKE // 2)
    ends = np.minimum(np.searchsorted(ordered, second + tolerance, side="right"), middle + _MOST_LIKE // 2)
    found = []
    for stamp, begin, end in zip(second.tolist(), begins.tolist(), ends.tolist(), strict=True):
        near = order[begin:end]
        if len(near) > 1:
            near = near[np.argsort(np.abs(first[near] - stamp), kind="stable")]
            near = near[np.sort(np.unique(runs[near], return_index=True)[1])]
        found.append(near)
    return found


def _traced(
    like: list[npt.NDArray[np.intp]], matched: npt.NDArray[np.intp], costs: list[list[_Cost]], origins: list[list[int]]
) -> npt.NDArray[np.intp]:
    """Return the path of least cost through the candidates of each matched pose (M,)."""
    chosen = np.empty(len(matched), dtype=np.intp)
    choice = costs[-1].index(min(costs[-1])) if costs else 0
    for number in range(len(matched) - 1, -1, -1):
        chosen[number] = like[matched[number]][choice]
        choice = origins[number][choice]
    return chosen


class RelationsError(TbmSlamError):
    """A file of relations cannot be used."""


@dataclass(frozen=True)
class Relations:
    """True motions between pairs of times."""

    stamps: FloatArray
    """Moments (N, 2) [s]: from, to."""
    motions: FloatArray
    """Pose (N, 3) at the second moment in the frame of the first: x, y [m], theta [rad]."""


@dataclass(frozen=True)
class RelationErrors:
    """Errors of estimated motions between the times of relations."""

    translations_m: FloatArray
    rotations_deg: FloatArray
    """Absolute error (M,) of every relation that could be checked."""
    checked: npt.NDArray[np.int64]
    """Indices (M,) of these relations."""
    pairs: npt.NDArray[np.int64]
    """Indices (M, 2) of the estimated poses that each of them was checked at: from, to."""
    unmatched: int
    """Relations without an estimated pose at one of their times."""


def read_relations(path: Path) -> Relations:
    """Read lines ``t1 t2 x y z roll pitch yaw`` with ``#`` comments; raise a `RelationsError` if that is impossible."""
    if why := why_unreadable(path):
        raise RelationsError(f"{path}: {why}: give a file of relations")
    try:
        with warnings.catch_warnings(action="ignore"):  # the check below refuses an empty file
            values = np.loadtxt(path, comments="#", ndmin=2, dtype=np.float64)
    except (OSError, ValueError) as error:
        raise RelationsError(f"{path}: cannot be read as relations (t1 t2 x y z roll pitch yaw): {error}") from None
    if values.shape[1:] != (8,) or not np.isfinite(values).all() or not len(values):
        raise RelationsError(f"{path}: expected lines of eight finite numbers t1 t2 x y z roll pitch yaw")
    if not np.abs(values[:, 2:4]).max() <= FARTHEST_PLACE:
        raise RelationsError(f"{path}: a relation is longer than {FARTHEST_PLACE:.0e} m: leave it out")
    return Relations(values[:, :2], values[:, [2, 3, 7]])


def relation_errors(relations: Relations, trajectory: Trajectory, tolerance: float = 1e-3) -> RelationErrors:
    """Compare the relative motions of a trajectory with the truth; stamps match within a tolerance [s]."""
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
