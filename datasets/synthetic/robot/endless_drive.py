"""A drive of any length through an unbounded building, simulated while it is read."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from datasets.synthetic.robot.drives import START_STAMP, drive_along
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise, poses_at
from datasets.synthetic.world.world import CorridorLattice, World
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.sensing.laser_scan import Reading

Route = Literal["round", "spiral"]

ROUTES: tuple[Route, ...] = ("round", "spiral")

_ARM_SPACING = 5  # blocks between the arms of a spiral: 10 km cover 1 km2 at a pitch of 20 m
_CHUNK = 100  # scans simulated at a time
_SPEED = 0.65  # [m/s]


@dataclass(frozen=True)
class EndlessDrive:
    """A simulated drive."""

    route: Route
    """"round": around one block, again and again, so that the map stays as it is; "spiral": outwards, through parts
    never seen before, so that the map grows with every metre."""
    length: float
    """Length of the drive [m]."""
    laser: SimulatedLaser
    """The simulated laser."""
    odometry: OdometryNoise
    """Noise of the odometry."""
    seed: int = 0
    """Seed of the building, the drive and all noise."""

    def __post_init__(self) -> None:
        """Check the route and its length."""
        if self.route not in ROUTES:
            raise ValueError(f"route must be one of {', '.join(ROUTES)}, got {self.route!r}")
        if self.laser.sweep > 0.0:
            raise ValueError(f"laser.sweep must be 0, got {self.laser.sweep}")
        if not 0.0 < self.length < float("inf"):
            raise ValueError(f"length must be positive, got {self.length}")

    def truth(self) -> Trajectory:
        """Return the true poses at every scan's stamp."""
        return self._drive[0]

    def readings(self) -> Iterator[Reading]:
        """Yield the readings; some hundred scans at a time are held in memory."""
        lattice = CorridorLattice(self.seed)
        rng = np.random.default_rng([self.seed, 41, 2])
        truth, odometry = self._drive
        for start in range(0, len(truth), _CHUNK):
            part = slice(start, start + _CHUNK)
            reach = self.laser.range_max + 1.0
            low, high = truth.poses[part, :2].min(axis=0) - reach, truth.poses[part, :2].max(axis=0) + reach
            walls = lattice.walls_near((low[0], low[1]), (high[0], high[1]))
            near = World("corridor lattice", self.seed, walls, truth.poses[:1, :2])
            scans = self.laser.scans(near, truth.stamps[part], truth.poses[part], rng)
            for scan, pose in zip(scans, odometry[part], strict=True):
                yield Reading(scan, SE2.from_array(pose), self.laser.T_robot_sensor)

    @cached_property
    def _drive(self) -> tuple[Trajectory, FloatArray]:
        """Return the true poses (N, 3) at every scan's stamp and those by odometry."""
        rng = np.random.default_rng([self.seed, 41, 1])
        path = _path(self.route, self.length + 2.0 * CorridorLattice().pitch)
        drive = drive_along(path, _SPEED, rng, START_STAMP, self.length)
        count = int((drive.stamps[-1] - START_STAMP) * self.laser.rate)
        stamps = START_STAMP + np.arange(count) / self.laser.rate
        return Trajectory(stamps, poses_at(drive, stamps)), poses_at(self.odometry.odometry(drive, rng), stamps)


def _path(route: Route, length: float) -> FloatArray:
    """Return points (N, 2) every 5 cm along the centre lines of corridors, up to at least a length [m]."""
    pitch = CorridorLattice().pitch
    corners = [np.zeros(2)]
    direction, driven, leg = np.array([1.0, 0.0]), 0.0, 0
    while driven < length:
        # A spiral's legs are 1, 1, 2, 2, 3, 3 ... spacings long.
        step = pitch if route == "round" else pitch * _ARM_SPACING * (leg // 2 + 1)
        corners.append(corners[-1] + direction * step)
        direction = np.array([-direction[1], direction[0]])
        driven, leg = driven + step, leg + 1
    legs = [
        start + (end - start) * np.arange(0.0, 1.0, 0.05 / float(np.hypot(*(end - start))))[:, None]
        for start, end in pairwise(corners)
    ]
    return np.vstack([*legs, corners[-1]])
