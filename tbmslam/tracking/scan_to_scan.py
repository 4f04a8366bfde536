"""Registration of a scan to the scans before it, point by point.

Sparse hits, for example among trees, form no surfaces. Their points still agree best at the right motion (E. Olson,
"Real-time correlative scan matching", ICRA 2009).
"""

from functools import reduce
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.search.correlation import WALL, GainField, correlate

_RESOLUTION = 0.1
_BLUR = 0.2
"""Standard deviation of the distance between hits of two scans on the same object [m]."""

_REACH, _TURN_REACH, _STEP = 6, 30, 0.02
"""Range of the search in cells and in steps of the heading to each side, and a step of the heading [rad]."""

_SHIFTS: FloatArray = _RESOLUTION * np.arange(-_REACH, _REACH + 1, dtype=np.float64)
_TURNS: FloatArray = _STEP * np.arange(-_TURN_REACH, _TURN_REACH + 1, dtype=np.float64)

_CHANGE = 0.15
"""Scale of the Cauchy distribution of the change of motion from scan to scan [m], [rad]."""

_PRIOR = 0.05
"""Weight of this distribution relative to the share of matching points."""

_FLOOR = 0.04, 0.01
"""Least standard deviations [m], [rad]: between scans of fr-clinic 19 of 20 errors are below twice these values."""

_UNLIKE = 0.35
"""Share of matching points below which earlier scans are compared too; few pairs of consecutive scans have less."""

_ALIKE = 0.55
"""Least share of matching points for two scans of the same place: 19 of 20 consecutive scans of fr-clinic have more. Of
pairs of different places 19 of 20 have less than .22 outdoors and less than .57 indoors."""

_LEAST_POINTS = 30
"""Least number of points. With 15 the error of a drive among pillars without odometry is 13 m, with 30 or without this
module 10 m (`weak-lasers`)."""

_KEPT = 9
"""Number of scans that are compared. A tilted robot, as over a kerb, sees the ground for one or two scans."""


class ScanMotion(NamedTuple):
    """The motion from an earlier scan to a scan."""

    motion: SE2
    """Pose of the scan in the frame of the earlier scan; by `RecentScans.place`, in the frame of the recent scans."""
    deviations: tuple[float, float]
    """Standard deviations of position [m] and heading [rad]."""
    alike: float
    """Share of its points that match the earlier scan."""

    @property
    def is_likely(self) -> bool:
        """Whether both scans show the same place."""
        return self.alike >= _ALIKE


class _PlacedScan(NamedTuple):
    """A scan's stamp, points (N, 2), pose, and motion since the scan before."""

    stamp: float
    points: FloatArray
    pose: SE2
    motion: SE2


class RecentScans:
    """The last scans of a drive."""

    def __init__(self) -> None:
        self._scans: list[_PlacedScan] = []

    def remember(self, stamp: float, points: FloatArray, pose: SE2) -> None:
        """Add a scan, or replace the scan of the same stamp after a second registration."""
        before = self._before(stamp)
        motion = before[-1].pose.to(pose) if before else SE2.identity()
        self._scans = [*before, _PlacedScan(stamp, points, pose, motion)][-_KEPT:]

    def place(self, stamp: float, points: FloatArray, guess: SE2) -> ScanMotion | None:
        """Return the pose of a scan with hits (N, 2) [m] in the frame of the recent scans; None without such scans.

        `guess` is the pose that continues the present motion, and `stamp` the time of the scan [s].
        """
        best: ScanMotion | None = None
        for scans, scan in enumerate(reversed(self._before(stamp)), start=1):
            if min(len(points), len(scan.points)) < _LEAST_POINTS:
                continue
            expected = scan.pose.to(guess) if scans == 1 else reduce(SE2.__matmul__, [scan.motion] * scans)
            found = motion_between(scan.points, points, expected)
            if best is None or found.alike > best.alike:
                best = found._replace(motion=scan.pose @ found.motion)
            if scans == 1 and found.alike >= _UNLIKE:
                break
        return best

    def _before(self, stamp: float) -> list[_PlacedScan]:
        """Return the scans with other stamps."""
        return [scan for scan in self._scans if scan.stamp != stamp]


def motion_between(before: FloatArray, now: FloatArray, guess: SE2) -> ScanMotion:
    """Return the motion, near a guess, between scans with hits (N, 2), (M, 2) in the frames of the laser [m]."""
    field, lattice = _field(before)
    sums = correlate(field, (*lattice,), np.ascontiguousarray(now), (*guess,), _TURNS, _REACH)
    alike = sums / (WALL * len(now))
    changes = _TURNS[:, None, None] ** 2 + _SHIFTS[:, None] ** 2 + _SHIFTS**2
    posterior = alike - _PRIOR * np.log1p(changes / _CHANGE**2)
    at = np.unravel_index(int(posterior.argmax()), posterior.shape)
    turn, up, right = (_peak(posterior, at, axis) for axis in range(3))
    motion = SE2(
        guess.x + (right - _REACH) * _RESOLUTION,
        guess.y + (up - _REACH) * _RESOLUTION,
        guess.theta + (turn - _TURN_REACH) * _STEP,
    )
    # Each point is a measurement, so the log posterior grows with the number of points.
    weights = np.exp(len(now) * (posterior - posterior[at]))
    by_turn, by_row, by_col = (
        _deviation(values, weights, others)
        for values, others in ((_TURNS, (1, 2)), (_SHIFTS, (0, 2)), (_SHIFTS, (0, 1)))
    )
    position = float(np.hypot(np.hypot(by_row, by_col), _FLOOR[0]))
    return ScanMotion(motion, (position, float(np.hypot(by_turn, _FLOOR[1]))), float(alike[at]))


def _field(points: FloatArray) -> tuple[GainField, Lattice]:
    """Return the scores of a point in the cells around hits (N, 2), and the lattice of the cells."""
    cells = np.floor(points / _RESOLUTION).astype(np.int64)
    low = cells.min(axis=0) - _REACH
    cells -= low
    free = np.ones((cells.max(axis=0) + 1 + _REACH)[::-1], dtype=np.uint8)
    free[cells[:, 1], cells[:, 0]] = 0
    distances = _RESOLUTION * cv2.distanceTransform(free, cv2.DIST_L2, 5)
    gains = np.rint(WALL * np.exp(-0.5 * (distances / _BLUR) ** 2)).astype(np.int8)
    return gains, Lattice(_RESOLUTION, int(low[1]), int(low[0]))


def _peak(values: FloatArray, at: tuple[np.intp, ...], axis: int) -> float:
    """Return the position of the peak of a parabola through the largest value and its neighbours along an axis."""
    index = int(at[axis])
    line = values[tuple(slice(None) if each == axis else at[each] for each in range(values.ndim))]
    if not 0 < index < len(line) - 1:
        return float(index)
    below, middle, above = line[index - 1 : index + 2].tolist()
    curvature = below - 2.0 * middle + above
    return index + 0.5 * (below - above) / curvature if curvature < 0.0 else float(index)


def _deviation(values: FloatArray, weights: npt.NDArray[Any], others: tuple[int, int]) -> float:
    """Return the standard deviation of values (N,) along an axis of weights, summed along the others."""
    shares = weights.sum(axis=others) / weights.sum()
    mean = float(values @ shares)
    return float(np.sqrt((values - mean) ** 2 @ shares))
