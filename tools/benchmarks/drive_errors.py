"""How far the maps of one drive, which may be several, are from what is known of the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.relations import Relations, matching_stamps, read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import fit_rigid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import read_tum
from tools.benchmarks.simulated_recording import beside

_SAME_SCAN_S = 1e-3
_SAME_POSE_S = 0.01


class NoTruthError(TbmSlamError):
    """Nothing is known of the truth of a recording."""


@dataclass(frozen=True)
class DriveErrors:
    """Errors of each relation, or of each true pose.

    Parameters
    ----------
    kind
        What the N errors are of.
    metres, degrees
        Errors (N,), nan if one cannot be scored; degrees are nan for poses.
    has_scans
        Which of them (N,) have scans at their stamps, so that they could be scored.
    """

    kind: Literal["relations", "poses"]
    metres: FloatArray
    degrees: FloatArray
    has_scans: npt.NDArray[np.bool_]

    def scored(self) -> npt.NDArray[np.bool_]:
        """Return which (N,) could be scored."""
        return np.isfinite(self.metres)

    def error_m(self, those: npt.NDArray[np.bool_]) -> float | None:
        """Return the mean error of some relations, or the root mean square of some poses' (ATE); None of none [m]."""
        metres = self.metres[those]
        if not len(metres):
            return None
        return float(metres.mean() if self.kind == "relations" else np.sqrt(np.mean(metres**2)))

    def error_deg(self, those: npt.NDArray[np.bool_]) -> float | None:
        """Return the mean error of some relations, None of none and of poses [deg]."""
        degrees = self.degrees[those]
        return float(degrees.mean()) if len(degrees) and self.kind == "relations" else None


def truth_beside(recording: Path) -> Path:
    """Return the file of relations, or else of true poses, beside a recording.

    Raises
    ------
    NoTruthError
        There is none.
    """
    for suffix in (".relations", ".truth.tum"):
        if (path := beside(recording, suffix)) is not None:
            return path
    raise NoTruthError(f"{recording}: has no .relations and no .truth.tum beside it, so it cannot be scored: add one")


def drive_errors(truth: Path, maps: Sequence[Trajectory], scans: FloatArray) -> DriveErrors:
    """Compare a drive with the truth.

    Parameters
    ----------
    truth
        What `truth_beside` returns.
    maps
        The poses of each map, all of its drives together: maps have frames of their own.
    scans
        Stamps (S,) of the scans that were given to be mapped [s].
    """
    if truth.name.endswith(".relations"):
        return _relation_errors(read_relations(truth), maps, scans)
    return _pose_errors(read_tum(truth), maps, scans)


def _relation_errors(relations: Relations, maps: Sequence[Trajectory], scans: FloatArray) -> DriveErrors:
    """Score each relation in the first map that has both of its moments; between two maps none can be."""
    metres, degrees = np.full((2, len(relations.stamps)), np.nan)
    for trajectory in maps:
        errors = relation_errors(relations, trajectory, _SAME_SCAN_S)
        is_new = np.isnan(metres[errors.checked])
        metres[errors.checked[is_new]] = errors.translations_m[is_new]
        degrees[errors.checked[is_new]] = errors.rotations_deg[is_new]
    ends = [_has_any(scans, relations.stamps[:, end], _SAME_SCAN_S) for end in (0, 1)]
    return DriveErrors("relations", metres, degrees, ends[0] & ends[1])


def _pose_errors(truth: Trajectory, maps: Sequence[Trajectory], scans: FloatArray) -> DriveErrors:
    """Score the poses of the map that has most of them; those of other maps, in other frames, cannot be."""
    metres = np.full(len(truth), np.nan)
    matches = [matching_stamps(trajectory.stamps, truth.stamps, _SAME_POSE_S) for trajectory in maps]
    most = max(range(len(maps)), key=lambda index: len(matches[index][0]), default=None)
    if most is not None and len(matches[most][0]) >= 2:
        found, true = matches[most]
        target, source = truth.poses[true, :2], maps[most].poses[found, :2]
        T_truth_map, _ = fit_rigid(target, source)
        metres[true] = np.hypot(*(T_truth_map.apply(source) - target).T)
    return DriveErrors("poses", metres, np.full(len(truth), np.nan), _has_any(scans, truth.stamps, _SAME_POSE_S))


def _has_any(scans: FloatArray, stamps: FloatArray, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return at which stamps (N,) there is a scan."""
    has = np.zeros(len(stamps), dtype=np.bool_)
    has[matching_stamps(scans, stamps, tolerance)[1]] = True
    return has
