"""Robots in a world: laser measurements, odometry that drifts, true poses, and drives of any length."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from datasets.synthetic.robot.drives import START_STAMP, drive_along
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.world.world import CorridorLattice, World
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angles
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text
from tbmslam.io.trajectory_file import write_tum
from tbmslam.parallel.executor import Progress
from tbmslam.sensing.laser_scan import Reading


@dataclass(frozen=True)
class OdometryNoise:
    """The odometry motion model of Thrun, Burgard and Fox, "Probabilistic Robotics" (2005), table 5.6.

    Each motion between two samples is taken apart into a turn, a translation and another turn, and each of the three
    gets a normal error. The variances are in squares of the motion, so their effect depends on how far apart samples
    are: the presets are meant for the 50 Hz of `datasets.synthetic.robot.drives`.
    """

    alpha1: float
    """Variance of a turn per squared turn."""
    alpha2: float
    """Variance of a turn per squared translation [rad^2/m^2]."""
    alpha3: float
    """Variance of a translation per squared translation."""
    alpha4: float
    """Variance of a translation per squared turn [m^2/rad^2]."""

    def __post_init__(self) -> None:
        """Check that no variance is negative."""
        for name in ("alpha1", "alpha2", "alpha3", "alpha4"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    @classmethod
    def preset(cls, name: str) -> "OdometryNoise":
        """Return noise by name: `none`, `good` (about 0.5 m after 140 m indoors) or `poor` (about 3 m)."""
        presets = {
            "none": cls(0.0, 0.0, 0.0, 0.0),
            "good": cls(0.002, 1.2e-5, 0.02, 4e-5),
            "poor": cls(0.07, 7e-4, 0.05, 1.3e-3),
        }
        if name not in presets:
            raise ValueError(f"name must be one of {', '.join(presets)}, got {name!r}")
        return presets[name]

    def odometry(self, drive: Trajectory, rng: np.random.Generator) -> Trajectory:
        """Return the odometry of a drive, in an odometry frame that begins at the drive's first pose."""
        turn_before, forward, turn_after = _motions(drive.poses)
        # Table 5.6, lines 5 to 7. The table subtracts a normal error, which has the same distribution as its sum.
        spread_before = np.sqrt(self.alpha1 * turn_before**2 + self.alpha2 * forward**2)
        spread_forward = np.sqrt(self.alpha3 * forward**2 + self.alpha4 * (turn_before**2 + turn_after**2))
        spread_after = np.sqrt(self.alpha1 * turn_after**2 + self.alpha2 * forward**2)
        errors = rng.standard_normal((3, len(forward)))
        turn_before = turn_before + errors[0] * spread_before
        forward = forward + errors[1] * spread_forward
        turn_after = turn_after + errors[2] * spread_after
        # Lines 8 to 10 for all steps: sums of the rotations, and of the translations along the headings.
        headings = np.concatenate(([0.0], np.cumsum(turn_before + turn_after)))
        along = headings[:-1] + turn_before
        poses = np.zeros_like(drive.poses)
        poses[1:, 0] = np.cumsum(forward * np.cos(along))
        poses[1:, 1] = np.cumsum(forward * np.sin(along))
        poses[:, 2] = wrap_angles(headings)
        return Trajectory(drive.stamps, poses)


def _motions(poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return turn, translation, turn (N - 1,) between poses; a robot that reverses has a negative translation.

    Table 5.6, lines 2 to 4, without their half turn for reversing and their random direction for a turn in place.
    """
    steps = np.diff(poses[:, :2], axis=0)
    turns = wrap_angles(np.diff(poses[:, 2]))
    forward = np.hypot(steps[:, 0], steps[:, 1])
    before = wrap_angles(np.arctan2(steps[:, 1], steps[:, 0]) - poses[:-1, 2])
    reverses = np.abs(before) > np.pi / 2.0
    forward = np.where(reverses, -forward, forward)
    before = np.where(reverses, wrap_angles(before + np.pi), before)
    before = np.where(np.abs(forward) < 1e-6, 0.0, before)
    return before, forward, wrap_angles(turns - before)


FIRST_SCAN_AFTER = 0.007
"""Time from a drive's first pose to the first scan [s]: scans fall between odometry samples, as in reality."""


@dataclass(frozen=True)
class SimulatedRobot:
    """One robot's recording and its truth."""

    name: str
    """`robot_K`."""
    laser: SimulatedLaser
    readings: tuple[Reading, ...] = field(repr=False)
    """Scans with odometry at their stamps, as a reader of its bag finds them."""
    odometry: Trajectory
    """All odometry (50 Hz), in an odometry frame that begins at the robot's first pose."""
    truth: Trajectory
    """The robot's true pose in the world's frame at the true time of every scan."""
    recorded: FloatArray = field(repr=False)
    """When the scans were taken by the recorder's clock (S,) [s], also where their stamps are wrong."""


def simulate(
    world: World,
    drives: Sequence[Trajectory],
    laser: SimulatedLaser,
    odometry: OdometryNoise,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[SimulatedRobot]:
    """Simulate the measurements of robots on true drives in the world's frame, see `plan_drives`."""
    progress = progress or Progress()
    rngs = np.random.default_rng([seed, 23]).spawn(len(drives))
    return [
        _simulate_robot(world, index, *each, laser, odometry)
        for index, each in enumerate(progress.each(zip(drives, rngs, strict=True), "simulating", len(drives), "robots"))
    ]


def _simulate_robot(
    world: World, index: int, drive: Trajectory, rng: np.random.Generator, laser: SimulatedLaser, noise: OdometryNoise
) -> SimulatedRobot:
    wheel_rng, laser_rng = rng.spawn(2)
    odometry = noise.odometry(drive, wheel_rng)
    first = drive.stamps[0] + FIRST_SCAN_AFTER
    if drive.stamps[-1] - laser.sweep < first:
        least = FIRST_SCAN_AFTER + laser.sweep
        raise ValueError(f"a drive must last at least {least:g} s for one scan, got {np.ptp(drive.stamps):g} s")
    stamps = first + np.arange(int((drive.stamps[-1] - laser.sweep - first) * laser.rate) + 1) / laser.rate
    # Stamps are whole microseconds, so that the nanoseconds of a bag represent them exactly.
    stamps = np.round(stamps * 1e6) / 1e6
    poses = poses_at(drive, stamps)
    scans = laser.scans(world, stamps, _between(drive, laser.moments(stamps)), laser_rng)
    swept = poses_at(odometry, stamps + laser.sweep) if laser.sweep > 0.0 else [None] * len(scans)
    readings = tuple(
        Reading(scan, SE2.from_array(pose), laser.T_robot_sensor, None if end is None else SE2.from_array(end))
        for scan, pose, end in zip(scans, poses_at(odometry, stamps), swept, strict=True)
    )
    return SimulatedRobot(f"robot_{index}", laser, readings, odometry, Trajectory(stamps, poses), stamps)


def _between(drive: Trajectory, moments: FloatArray) -> FloatArray:
    """Return the poses (S, M, 3) of a drive at many times (S, M)."""
    if moments.shape[1] == 1:
        return poses_at(drive, moments[:, 0])[:, None]
    x, y, theta = drive.poses[:, 0], drive.poses[:, 1], np.unwrap(drive.poses[:, 2])
    return np.stack([np.interp(moments, drive.stamps, values) for values in (x, y, theta)], axis=-1)


def poses_at(trajectory: Trajectory, stamps: FloatArray) -> FloatArray:
    """Return the poses (S, 3) at stamps (S,) within a trajectory, at constant twist between its poses."""
    after = np.searchsorted(trajectory.stamps, stamps, side="right").clip(1, len(trajectory) - 1)
    before = trajectory.stamps[after - 1]
    fractions = (stamps - before) / (trajectory.stamps[after] - before)
    poses = [
        trajectory.pose(index - 1).interpolate(trajectory.pose(index), float(fraction))
        for index, fraction in zip(after.tolist(), fractions, strict=True)
    ]
    return np.array(poses).reshape(-1, 3)


_SOURCE = "the simulated world, ground truth"  # kind of the file; truth files of build_maps have the same name


def write_truth(
    folder: Path, world: World, robots: Sequence[SimulatedRobot], bags: Sequence[str], run: Mapping[str, object]
) -> None:
    """Write `world.npz`, `<bag stem>.truth.tum` for each robot, and `truth.json` to a folder, each atomically.

    `bags` are the names of the robots' bags in the folder, and `run` the settings of the recording for JSON.
    """
    world.save(folder / "world.npz")
    entries = []
    for robot, bag in zip(robots, bags, strict=True):
        tum = f"{Path(bag).stem}.truth.tum"
        write_tum(folder / tum, robot.truth)
        entries.append(
            {
                "name": robot.name,
                "bag": bag,
                "trajectory": tum,
                "T_world_robot": list(robot.truth.pose(0)),
                "scans": len(robot.readings),
                "length_m": robot.truth.length(),
                "duration_s": float(robot.truth.stamps[-1] - robot.truth.stamps[0]),
            }
        )
    laser = robots[0].laser
    truth = {
        **run,
        "source": _SOURCE,
        "world": {"name": world.name, "seed": world.seed, "file": "world.npz"},
        "laser": {**vars(laser), "T_robot_sensor": list(laser.T_robot_sensor)},
        "robots": entries,
    }
    write_text(folder / "truth.json", json.dumps(truth, indent=2, sort_keys=True) + "\n")


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
    odometry: OdometryNoise
    seed: int = 0

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
