"""Rigid motions of the plane.

``T_a_b`` carries coordinates in frame b to frame a, ``p_a = T_a_b @ p_b``; in a product the inner letters agree:
``T_a_c = T_a_b @ T_b_c``.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class SE2(NamedTuple):
    """A rigid motion of the plane, or a pose: translation in metres, rotation in radians.

    A named tuple, so that it enters compiled kernels as it is.
    """

    x: float
    y: float
    theta: float

    @classmethod
    def identity(cls) -> "SE2":
        """Return the motion that moves nothing."""
        return cls(0.0, 0.0, 0.0)

    @classmethod
    def from_matrix(cls, matrix: FloatArray) -> "SE2":
        """Read a (3, 3) homogeneous matrix whose upper left block is a rotation."""
        return cls(float(matrix[0, 2]), float(matrix[1, 2]), math.atan2(float(matrix[1, 0]), float(matrix[0, 0])))

    @classmethod
    def from_array(cls, values: npt.ArrayLike) -> "SE2":
        """Read x, y, theta from anything of length three."""
        x, y, theta = np.asarray(values, dtype=np.float64).tolist()
        return cls(x, y, theta)

    @classmethod
    def exp(cls, vx: float, vy: float, omega: float) -> "SE2":
        """Exponential map: the pose reached by the constant twist (vx, vy, omega) after unit time.

        Sola et al., "A micro Lie theory for state estimation in robotics", eq. 156 and 158.
        """
        sine_ratio, versine_ratio = _sine_ratios(omega)
        return cls(sine_ratio * vx - versine_ratio * vy, versine_ratio * vx + sine_ratio * vy, wrap_angle(omega))

    def log(self) -> tuple[float, float, float]:
        """Return the twist (vx, vy, omega) whose exponential this is, omega in [-pi, pi); Sola et al., eq. 157."""
        omega = wrap_angle(self.theta)
        sine_ratio, versine_ratio = _sine_ratios(omega)
        scale = 1.0 / (sine_ratio**2 + versine_ratio**2)
        vx = scale * (sine_ratio * self.x + versine_ratio * self.y)
        vy = scale * (sine_ratio * self.y - versine_ratio * self.x)
        return vx, vy, omega

    def __matmul__(self, other: "SE2") -> "SE2":
        """Return the composition: first `other`, then this motion."""
        x, y, theta = self
        dx, dy, turn = other
        cosine, sine = math.cos(theta), math.sin(theta)
        heading = theta + turn
        if not -math.pi <= heading < math.pi:
            heading = wrap_angle(heading)
        # The tuple is made without the named tuple's own constructor, which would take longer than all the rest.
        return tuple.__new__(SE2, (x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, heading))

    def to(self, other: "SE2") -> "SE2":
        """Return `self.inverse() @ other` in half the time: the other pose in the frame of this pose."""
        x, y, theta = self
        dx, dy, heading = other[0] - x, other[1] - y, other[2] - theta
        cosine, sine = math.cos(theta), math.sin(theta)
        if not -math.pi <= heading < math.pi:
            heading = wrap_angle(heading)
        return tuple.__new__(SE2, (cosine * dx + sine * dy, cosine * dy - sine * dx, heading))

    def inverse(self) -> "SE2":
        """Return the inverse motion."""
        x, y, theta = self
        cosine, sine = math.cos(theta), math.sin(theta)
        return tuple.__new__(SE2, (-cosine * x - sine * y, sine * x - cosine * y, wrap_angle(-theta)))

    def apply(self, points: npt.ArrayLike) -> FloatArray:
        """Transform points (..., 2) [m] to the other frame."""
        xy = np.asarray(points, dtype=np.float64)
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        moved = np.empty_like(xy)
        moved[..., 0] = self.x + cosine * xy[..., 0] - sine * xy[..., 1]
        moved[..., 1] = self.y + sine * xy[..., 0] + cosine * xy[..., 1]
        return moved

    def matrix(self) -> FloatArray:
        """Return the (3, 3) homogeneous matrix."""
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        return np.array([[cosine, -sine, self.x], [sine, cosine, self.y], [0.0, 0.0, 1.0]])

    def interpolate(self, other: "SE2", fraction: float) -> "SE2":
        """Return the pose at `fraction` of the constant-twist motion from this pose (0) to `other` (1)."""
        vx, vy, omega = (self.inverse() @ other).log()
        return self @ SE2.exp(fraction * vx, fraction * vy, fraction * omega)


def wrap_angle(angle: float) -> float:
    """Return the same direction within [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi if not -math.pi <= angle < math.pi else angle


def wrap_angles(angles: npt.ArrayLike) -> FloatArray:
    """Return the same directions within [-pi, pi), up to rounding, for arrays of any shape."""
    angles = np.asarray(angles, dtype=np.float64)
    # Not by the operator %, which takes seven times as long.
    return np.asarray(angles - 2.0 * np.pi * np.floor((angles + np.pi) / (2.0 * np.pi)))


def stacked(poses: Sequence[tuple[float, float, float]]) -> FloatArray:
    """Return poses as an array (N, 3), in a fifth of the time that NumPy takes for a list of tuples."""
    numbers = itertools.chain.from_iterable(poses)
    return np.fromiter(numbers, dtype=np.float64, count=3 * len(poses)).reshape(-1, 3)


def compose(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return `first @ second` for motions (..., 3) in arrays."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = second[..., 0], second[..., 1]
    return _in_rows(
        first[..., 0] + cosine * x - sine * y,
        first[..., 1] + sine * x + cosine * y,
        wrap_angles(first[..., 2] + second[..., 2]),
    )


def inverse(motions: FloatArray) -> FloatArray:
    """Return the motions that undo motions (..., 3)."""
    cosine, sine = np.cos(motions[..., 2]), np.sin(motions[..., 2])
    x, y = motions[..., 0], motions[..., 1]
    return _in_rows(-cosine * x - sine * y, sine * x - cosine * y, wrap_angles(-motions[..., 2]))


def _in_rows(x: FloatArray, y: FloatArray, heading: FloatArray) -> FloatArray:
    """Return motions (..., 3) of their coordinates (...), in a third of the time of `np.stack`."""
    motions = np.empty((*heading.shape, 3))
    motions[..., 0], motions[..., 1], motions[..., 2] = x, y, heading
    return motions


def differences(poses: FloatArray, pose: FloatArray) -> FloatArray:
    """Return the differences of the coordinates of poses (N, 3) and a pose (3,), with the angles wrapped."""
    apart = poses - pose
    apart[:, 2] = wrap_angles(apart[:, 2])
    return apart


def median_pose(poses: FloatArray) -> SE2:
    """Return the median of each coordinate of near poses (N, 3), N > 0; angles may lie on both sides of pi."""
    x, y, heading = (poses[0] + np.median(differences(poses, poses[0]), axis=0)).tolist()
    return SE2(x, y, wrap_angle(heading))


def path_lengths(points: FloatArray) -> FloatArray:
    """Return the length of the path from the first of points or poses (N, >= 2) to each (N,) [m]."""
    travelled = np.zeros(len(points))
    np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T), out=travelled[1:])
    return travelled


def log(motions: FloatArray) -> FloatArray:
    """Return the twists (N, 3) whose exponentials are motions (N, 3); Sola et al., eq. 157."""
    turn = wrap_angles(motions[:, 2])
    half = 0.5 * turn
    # the inverse of eq. 158 needs half the turn's cotangent
    cotangent = np.where(np.abs(half) < 1e-4, 1.0 - half**2 / 3.0, half / np.tan(np.where(half == 0.0, 1.0, half)))
    vx = cotangent * motions[:, 0] + half * motions[:, 1]
    vy = cotangent * motions[:, 1] - half * motions[:, 0]
    return np.column_stack((vx, vy, turn))


def adjoints(poses: FloatArray) -> FloatArray:
    """Return the matrices (N, 3, 3) that carry small motions in the frames of poses (N, 3) to the map; eq. 159."""
    adjoints = np.zeros((len(poses), 3, 3))
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    adjoints[:, 0, 0], adjoints[:, 0, 1], adjoints[:, 0, 2] = cosine, -sine, poses[:, 1]
    adjoints[:, 1, 0], adjoints[:, 1, 1], adjoints[:, 1, 2] = sine, cosine, -poses[:, 0]
    adjoints[:, 2, 2] = 1.0
    return adjoints


def interpolate(begins: FloatArray, ends: FloatArray, shares: FloatArray) -> FloatArray:
    """Return the poses at shares (N,) of the constant-twist motions from some poses (N, 3) to others."""
    vx, vy, turn = (log(compose(inverse(begins), ends)) * shares[:, None]).T
    along, across = np.sinc(turn / np.pi), 0.5 * turn * np.sinc(0.5 * turn / np.pi) ** 2
    return compose(begins, np.column_stack((along * vx - across * vy, across * vx + along * vy, turn)))


def laid_out(start: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the poses (S + 1, 3) along steps (S, 3) from a pose (3,)."""
    headings = start[2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    cosines, sines = np.cos(headings[:-1]), np.sin(headings[:-1])
    moved_x, moved_y = cosines * steps[:, 0] - sines * steps[:, 1], sines * steps[:, 0] + cosines * steps[:, 1]
    poses = np.empty((len(headings), 3))
    poses[0], poses[:, 2] = start, wrap_angles(headings)
    poses[1:, 0], poses[1:, 1] = start[0] + np.cumsum(moved_x), start[1] + np.cumsum(moved_y)
    return poses


def _sine_ratios(omega: float) -> tuple[float, float]:
    """Return sin(w)/w and (1 - cos(w))/w, by their series where the quotients lose digits."""
    if abs(omega) < 1e-4:
        return 1.0 - omega**2 / 6.0, omega / 2.0 - omega**3 / 24.0
    return math.sin(omega) / omega, (1.0 - math.cos(omega)) / omega
