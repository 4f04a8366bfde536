"""A simulated laser range finder: exact geometry, then what real ones add."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from datasets.synthetic.world import World
from tbmslam.kernels.ray_casting import cast_rays
from tbmslam.laser_scan import LaserScan
from tbmslam.se2 import SE2, FloatArray

_BEAMS_OVER_180_DEG = {180: 1.0, 181: 1.0, 361: 0.5}
"""Usual SICK scanners: beams and their step [deg]."""


STATA_MOUNT = SE2(0.275, 0.0, 0.0)
"""Where a PR2 carries its base laser."""


@dataclass(frozen=True)
class SimulatedLaser:
    """What a laser is like; the default is the base laser of MIT's PR2 at the Stata Center.

    Parameters
    ----------
    beams, angle_min, angle_increment
        Directions of the beams in the sensor's own frame [rad].
    rate
        Scans a second [Hz].
    range_min, range_max
        Limits of what it can measure [m].
    noise
        Standard deviation of a range [m].
    dropouts
        Fraction of beams that return nothing although there is something.
    wrong_returns
        Fraction of beams that return too early, anywhere before the wall.
    T_robot_sensor
        Where it is mounted.
    upside_down
        Whether it hangs from its mount, so that its beams turn clockwise seen from above.
    """

    beams: int = 1040
    angle_min: float = -2.26892805
    angle_increment: float = 0.00436332
    rate: float = 20.0
    range_min: float = 0.023
    range_max: float = 30.0
    noise: float = 0.01
    dropouts: float = 0.003
    wrong_returns: float = 0.001
    T_robot_sensor: SE2 = STATA_MOUNT
    upside_down: bool = False

    def __post_init__(self) -> None:
        """Check every value against what a laser can be."""
        for name in ("beams", "rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0.0 <= self.range_min < self.range_max < math.inf:
            raise ValueError(f"range_max must be finite and above range_min, got {self.range_min}, {self.range_max}")
        if not 0.0 < abs(self.angle_increment) * (self.beams - 1) < 2.0 * math.pi and self.beams > 1:
            raise ValueError(f"beams must lie within one turn, got {self.beams} steps of {self.angle_increment} rad")
        for name in ("noise", "dropouts", "wrong_returns"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @staticmethod
    def field_of(beams: int) -> tuple[float, float]:
        """Return angle_min and angle_increment [rad] that a laser with so many beams usually has.

        180, 181 and 361 beams are a SICK's half turn to the right of straight left, others spread over the default's
        260 degrees.
        """
        if beams in _BEAMS_OVER_180_DEG:
            return -math.pi / 2.0, math.radians(_BEAMS_OVER_180_DEG[beams])
        usual = SimulatedLaser()
        return usual.angle_min, usual.angle_increment * usual.beams / max(beams, 1)

    def scans(
        self, world: World, stamps: FloatArray, robot_poses: FloatArray, rng: np.random.Generator
    ) -> list[LaserScan]:
        """Return what the laser measures at robot poses (S, 3) in the world, at stamps (S,) [s].

        Values are rounded to float32 as a LaserScan message holds them; no return is `inf` (REP 117). An upside-down
        laser's scans have a negative increment, as `LaserScan` demands.
        """
        turn = -1.0 if self.upside_down else 1.0
        angle_min, increment = (turn * float(np.float32(angle)) for angle in (self.angle_min, self.angle_increment))
        sensors = np.array([SE2.from_array(pose) @ self.T_robot_sensor for pose in robot_poses]).reshape(-1, 3)
        ranges = np.empty((len(sensors), self.beams))
        # A wall just beyond reach may be measured within it.
        cast_rays(world.walls, sensors, angle_min, increment, self.range_max + 5.0 * self.noise, ranges)
        ranges = self._corrupted(ranges, rng).astype(np.float64)
        limits = float(np.float32(self.range_min)), float(np.float32(self.range_max))
        return [
            LaserScan(float(stamp), angle_min, increment, *limits, row)
            for stamp, row in zip(stamps, ranges, strict=True)
        ]

    def _corrupted(self, exact: FloatArray, rng: np.random.Generator) -> npt.NDArray[np.float32]:
        ranges = exact + rng.normal(0.0, self.noise, exact.shape)
        chance = rng.random(exact.shape)
        early = chance < self.wrong_returns
        ranges[early] = rng.uniform(self.range_min, np.minimum(exact[early], self.range_max))
        ranges[chance > 1.0 - self.dropouts] = np.inf
        rounded = ranges.astype(np.float32)
        rounded[(rounded < self.range_min) | (rounded > self.range_max)] = np.inf
        return rounded
