"""Rigid motions in space, as recordings hold them; the map needs only their planar part."""

import math
from typing import NamedTuple

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import FARTHEST_PLACE


class SE3(NamedTuple):
    """A rigid motion in space: translation [m] and unit quaternion.

    Plain numbers rather than arrays: a recording asks for one interpolation and two products a scan.
    """

    x: float
    y: float
    z: float
    qx: float
    qy: float
    qz: float
    qw: float

    @classmethod
    def identity(cls) -> "SE3":
        """Return the motion that moves nothing."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_values(cls, x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float) -> "SE3 | None":
        """Read recorded numbers, normalising the quaternion; None if they are no motion (not finite, or all 0)."""
        norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        if not 1e-6 < norm < math.inf or not abs(x) + abs(y) + abs(z) <= FARTHEST_PLACE:
            return None
        return cls(x, y, z, qx / norm, qy / norm, qz / norm, qw / norm)

    @classmethod
    def from_planar(cls, pose: SE2) -> "SE3":
        """Return a planar motion as a motion in space, with z = 0."""
        return cls(pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(0.5 * pose.theta), math.cos(0.5 * pose.theta))

    def __matmul__(self, other: "SE3") -> "SE3":
        """Return the composition: first `other`, then this motion."""
        x, y, z = self.rotated(other.x, other.y, other.z)
        ax, ay, az, aw = self.qx, self.qy, self.qz, self.qw
        bx, by, bz, bw = other.qx, other.qy, other.qz, other.qw
        return SE3(
            self.x + x,
            self.y + y,
            self.z + z,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    def inverse(self) -> "SE3":
        """Return the inverse motion."""
        turned_back = SE3(0.0, 0.0, 0.0, -self.qx, -self.qy, -self.qz, self.qw)
        x, y, z = turned_back.rotated(self.x, self.y, self.z)
        return SE3(-x, -y, -z, -self.qx, -self.qy, -self.qz, self.qw)

    def interpolate(self, other: "SE3", fraction: float) -> "SE3":
        """Return the motion at `fraction` between this (0) and `other` (1): straight line and slerp.

        Shoemake, "Animating rotation with quaternion curves", 1985. Fractions above 1 extrapolate the motion.
        """
        cosine = self.qx * other.qx + self.qy * other.qy + self.qz * other.qz + self.qw * other.qw
        sign = -1.0 if cosine < 0.0 else 1.0  # q and -q are the same rotation: take the shorter path
        angle = math.acos(min(1.0, sign * cosine))
        if angle < 1e-6:
            a, b = 1.0 - fraction, sign * fraction
        else:
            a = math.sin((1.0 - fraction) * angle) / math.sin(angle)
            b = sign * math.sin(fraction * angle) / math.sin(angle)
        return SE3(
            self.x + fraction * (other.x - self.x),
            self.y + fraction * (other.y - self.y),
            self.z + fraction * (other.z - self.z),
            a * self.qx + b * other.qx,
            a * self.qy + b * other.qy,
            a * self.qz + b * other.qz,
            a * self.qw + b * other.qw,
        )

    def planar(self) -> SE2:
        """Project to the plane z = 0: position and direction of the x axis."""
        heading = math.atan2(
            2.0 * (self.qx * self.qy + self.qw * self.qz), 1.0 - 2.0 * (self.qy * self.qy + self.qz * self.qz)
        )
        return SE2(self.x, self.y, heading)

    def up(self) -> float:
        """Return the upward component of the z axis: 1 upright, 0 horizontal, -1 upside down."""
        return 1.0 - 2.0 * (self.qx * self.qx + self.qy * self.qy)

    def rotated(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return a vector rotated: v + 2 q x (q x v + w v)."""
        qx, qy, qz, qw = self.qx, self.qy, self.qz, self.qw
        cx = qy * z - qz * y + qw * x
        cy = qz * x - qx * z + qw * y
        cz = qx * y - qy * x + qw * z
        return (x + 2.0 * (qy * cz - qz * cy), y + 2.0 * (qz * cx - qx * cz), z + 2.0 * (qx * cy - qy * cx))
