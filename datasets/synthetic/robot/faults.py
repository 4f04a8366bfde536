"""Faults of real robots, injected into a simulated robot at a chosen time."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from datasets.synthetic.robot.simulation import SimulatedRobot, poses_at
from datasets.synthetic.robot.surroundings import (
    behind_glass,
    behind_posts,
    in_a_cabin,
    ranges_of,
    with_moved_boxes,
    with_people,
    within_a_crowd,
)
from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray
from tbmslam.geometry.trajectory import Trajectory

_JUMP = SE2(2.0, 1.0, 1.0)  # of the odometry, in the robot's frame
_CLOCK_FAULT = 82.2  # as in some recordings of the MIT Stata Center [s]
_CLOCK_STEP, _STEP_BACK = 3.0, 0.3  # [s]
_CARRIED_FOR = 2.0  # [s]
_TOO_LONG = 1.1  # factor
_TOO_WIDE, _TOO_FAR = 1.03, 0.1  # factor of the angles between beams; error of the ranges [m]
_ELSEWHERE = SE2(0.0, 0.3, math.radians(10.0))  # of the laser, relative to its true pose
_KNOCKED = math.radians(10.0)  # to the left
_COVER = 0.25  # range of blocked beams [m]


@dataclass(frozen=True)
class Fault:
    """A fault."""

    name: str
    """One of `FAULTS`."""
    at: float
    """Begin after the start of the drive [s]."""
    seconds: float = 10.0
    """Duration, if it ends [s]."""
    scale: float = 1.0
    """Factor of the lengths of reversed odometry."""

    def __post_init__(self) -> None:
        """Check name, times and scale."""
        if self.name not in FAULTS:
            raise ValueError(f"a fault must be one of {', '.join(FAULTS)}, got {self.name!r}")
        if not (0.0 <= self.at < math.inf and 0.0 < self.seconds <= math.inf):
            raise ValueError(f"at must not be negative and seconds be positive, got {self.at}, {self.seconds}")
        if not 0.0 < self.scale < math.inf:
            raise ValueError(f"scale must be positive, got {self.scale}")
        if self.scale != 1.0 and self.name != "odometry_reversed":
            raise ValueError(f"only odometry_reversed has a scale, got {self.scale} for {self.name}")

    @classmethod
    def parse(cls, text: str) -> "Fault":
        """Read NAME@TIME, NAME@TIME+SECONDS or NAME@TIME+SECONDSxSCALE."""
        found = re.fullmatch(r"([a-z_]+)@(\d*\.?\d+)(?:\+(\d*\.?\d+)(?:x(\d*\.?\d+))?)?", text)
        if found is None:
            raise ValueError(
                f"a fault must look like laser_gap@30, laser_gap@30+60 or odometry_reversed@30+6x2.7, got {text!r}"
            )
        return cls(found[1], float(found[2]), float(found[3] or 10.0), float(found[4] or 1.0))


@dataclass(frozen=True)
class _Scene:
    """A robot, and the time in which the fault is active [s]."""

    robot: SimulatedRobot
    begin: float
    end: float
    world: World
    rng: np.random.Generator
    scale: float = 1.0

    def scans(self) -> BoolArray:
        """Return which scans (S,) are in this time."""
        return np.asarray((self.robot.recorded >= self.begin) & (self.robot.recorded < self.end))

    def odometry(self) -> BoolArray:
        """Return which samples of the odometry (N,) are in this time."""
        return np.asarray((self.robot.odometry.stamps >= self.begin) & (self.robot.odometry.stamps < self.end))


def inject(robot: SimulatedRobot, fault: Fault, world: World, seed: int = 0) -> SimulatedRobot:
    """Return the robot's recording with a fault; the truth stays correct, with the stamps of the scans."""
    begin = float(robot.recorded[0]) + fault.at
    scene = _Scene(robot, begin, begin + fault.seconds, world, np.random.default_rng([seed, 57]), fault.scale)
    return FAULTS[fault.name](scene)


def _odometry_gap(scene: _Scene) -> SimulatedRobot:
    """Remove the odometry."""
    odometry, kept = scene.robot.odometry, ~scene.odometry()
    return replace(scene.robot, odometry=Trajectory(odometry.stamps[kept], odometry.poses[kept]))


def _odometry_jump(scene: _Scene) -> SimulatedRobot:
    """Let odometry jump once."""
    before = _odometry_at(scene.robot, scene.begin)
    return _odometry_moved(scene.robot, scene.begin, before @ _JUMP @ before.inverse())


def _odometry_freeze(scene: _Scene) -> SimulatedRobot:
    """Stop the odometry while the robot drives; then it jumps to the right pose."""
    poses = scene.robot.odometry.poses.copy()
    poses[scene.odometry()] = _odometry_at(scene.robot, scene.begin)
    return replace(scene.robot, odometry=Trajectory(scene.robot.odometry.stamps, poses))


def _odometry_stuck(scene: _Scene) -> SimulatedRobot:
    """Stop the odometry while the robot is pushed."""
    before, after = (_odometry_at(scene.robot, stamp) for stamp in (scene.begin, scene.end))
    return _odometry_moved(_odometry_freeze(scene), scene.end, before @ after.inverse())


def _odometry_reversed(scene: _Scene) -> SimulatedRobot:
    """Reverse the translations of the odometry; rotations stay."""
    odometry, wrong = scene.robot.odometry, np.flatnonzero(scene.odometry())
    poses = odometry.poses.copy()
    for index in wrong[wrong > 0].tolist():
        motion = odometry.pose(index - 1).to(odometry.pose(index))
        reported = SE2(-scene.scale * motion.x, -scene.scale * motion.y, motion.theta)
        poses[index] = SE2.from_array(poses[index - 1]) @ reported
    robot = replace(scene.robot, odometry=Trajectory(odometry.stamps, poses))
    if not len(wrong) or wrong[-1] + 1 == len(poses):
        return robot
    T_reported_true = SE2.from_array(poses[wrong[-1]]) @ odometry.pose(wrong[-1]).inverse()
    return _odometry_moved(robot, float(odometry.stamps[wrong[-1] + 1]), T_reported_true)


def _odometry_unit(scene: _Scene) -> SimulatedRobot:
    """State the lengths of the odometry in centimetres, during the whole drive."""
    odometry = scene.robot.odometry
    return replace(scene.robot, odometry=Trajectory(odometry.stamps, odometry.poses * (100.0, 100.0, 1.0)))


def _clock_offset(scene: _Scene) -> SimulatedRobot:
    """Shift the stamps of all scans relative to the clock of the odometry."""
    return _restamped(scene.robot, scene.robot.truth.stamps - _CLOCK_FAULT)


def _clock_step(scene: _Scene) -> SimulatedRobot:
    """Shift the clock of the scans for a while."""
    robot = _restamped(scene.robot, scene.robot.truth.stamps - _CLOCK_STEP * scene.scans())
    return replace(robot, truth=scene.robot.truth)  # the reader corrects the clock


def _stamps_back(scene: _Scene) -> SimulatedRobot:
    """Make every tenth stamp of the scans a little too early."""
    early = scene.scans() & (np.arange(len(scene.robot.truth)) % 10 == 0)
    return _restamped(scene.robot, scene.robot.truth.stamps - _STEP_BACK * early)


def _stamps_twice(scene: _Scene) -> SimulatedRobot:
    """Give every second scan the stamp of the scan before."""
    stamps = scene.robot.truth.stamps.copy()
    twice = np.flatnonzero(scene.scans() & (np.arange(len(stamps)) % 2 == 1))
    stamps[twice] = stamps[np.maximum(twice - 1, 0)]
    return _restamped(scene.robot, stamps)


def _laser_gap(scene: _Scene) -> SimulatedRobot:
    """Remove scans while the robot drives."""
    kept, truth = ~scene.scans(), scene.robot.truth
    if not kept.any():
        raise ValueError("a fault must leave at least one scan: shorten it")
    readings = tuple(reading for reading, keep in zip(scene.robot.readings, kept, strict=True) if keep)
    truth = Trajectory(truth.stamps[kept], truth.poses[kept])
    return replace(scene.robot, readings=readings, truth=truth, recorded=scene.robot.recorded[kept])


def _beams_blocked(scene: _Scene) -> SimulatedRobot:
    """Block half of the beams by an object on the robot."""
    ranges = ranges_of(scene.robot)
    half = ranges[:, : ranges.shape[1] // 2]
    half[:] = (_COVER + scene.rng.normal(0.0, 0.003, half.shape)).astype(np.float32)
    return _rescanned(scene.robot, scene.scans(), ranges)


def _angle_step(scene: _Scene) -> SimulatedRobot:
    """State too large an angle between beams."""
    readings = [
        replace(reading, scan=replace(reading.scan, angle_increment=_TOO_WIDE * reading.scan.angle_increment))
        if is_wrong
        else reading
        for reading, is_wrong in zip(scene.robot.readings, scene.scans(), strict=True)
    ]
    return replace(scene.robot, readings=tuple(readings))


def _mount(scene: _Scene) -> SimulatedRobot:
    """State a wrong mount of the laser, during the whole drive."""
    stated = scene.robot.laser.T_robot_sensor @ _ELSEWHERE
    readings = tuple(replace(reading, T_robot_sensor=stated) for reading in scene.robot.readings)
    return replace(scene.robot, readings=readings)


def _laser_knocked(scene: _Scene) -> SimulatedRobot:
    """Turn the laser on the robot to the left by some beams; its last beams become nan."""
    ranges, step = ranges_of(scene.robot), scene.robot.readings[0].scan.angle_increment
    beams = min(round(_KNOCKED / abs(step)), ranges.shape[1])
    turned = np.full_like(ranges, np.nan)
    if step > 0.0:
        turned[:, : ranges.shape[1] - beams] = ranges[:, beams:]
    else:
        turned[:, beams:] = ranges[:, : ranges.shape[1] - beams]
    return _rescanned(scene.robot, scene.scans(), turned)


def _scans_repeated(scene: _Scene) -> SimulatedRobot:
    """Let the laser repeat one scan."""
    ranges, those = ranges_of(scene.robot), scene.scans()
    return _rescanned(scene.robot, those, np.repeat(ranges[those.argmax()][None], len(ranges), axis=0))


def _furniture(scene: _Scene) -> SimulatedRobot:
    """Add boxes, and move all of them at once."""
    ranges = with_moved_boxes(scene.robot, scene.begin, scene.rng)
    return _rescanned(scene.robot, np.ones(len(ranges), dtype=np.bool_), ranges)


def _carried(scene: _Scene) -> SimulatedRobot:
    """Carry the robot to a later pose of its drive without odometry."""
    begin, end = scene.begin, scene.end
    T_before_after = _odometry_at(scene.robot, begin) @ _odometry_at(scene.robot, end).inverse()
    robot = _laser_gap(replace(scene, robot=_odometry_gap(scene)))
    robot = _odometry_moved(robot, end, T_before_after)
    later = _CARRIED_FOR - (end - begin)
    waited = later * (robot.recorded >= end)
    wheels = robot.odometry.stamps + later * (robot.odometry.stamps >= end)
    robot = replace(robot, odometry=Trajectory(wheels, robot.odometry.poses))
    return replace(_restamped(robot, robot.truth.stamps + waited), recorded=robot.recorded + waited)


def _lift(scene: _Scene) -> SimulatedRobot:
    """Move the robot in a closed cabin to a later pose of its drive, without odometry."""
    robot = scene.robot
    shut, middle = scene.scans(), 0.5 * (scene.begin + scene.end)
    poses = robot.truth.poses.copy()
    if shut.any():
        first, last = np.flatnonzero(shut)[[0, -1]]
        poses[shut] = np.where((robot.recorded[shut] < middle)[:, None], poses[first], poses[last])
    lifted = _rescanned(_odometry_stuck(scene), shut, in_a_cabin(robot, scene.rng))
    return replace(lifted, truth=Trajectory(robot.truth.stamps, poses))


FAULTS: Mapping[str, Callable[[_Scene], SimulatedRobot]] = {
    "odometry_gap": _odometry_gap,
    "odometry_jump": _odometry_jump,
    "odometry_reset": lambda scene: _odometry_moved(
        scene.robot, scene.begin, _odometry_at(scene.robot, scene.begin).inverse()
    ),  # restarts at zero
    "odometry_freeze": _odometry_freeze,
    "odometry_stuck": _odometry_stuck,
    "odometry_reversed": _odometry_reversed,
    "odometry_unit": _odometry_unit,
    "clock_offset": _clock_offset,
    "clock_step": _clock_step,
    "stamps_back": _stamps_back,
    "stamps_twice": _stamps_twice,
    "laser_gap": _laser_gap,
    "beams_blocked": _beams_blocked,
    "parts_in_view": lambda scene: _measuring(scene, behind_posts(scene.robot, scene.rng)),
    "range_scale": lambda scene: _measuring(scene, (_TOO_LONG * ranges_of(scene.robot)).astype(np.float32)),
    "range_offset": lambda scene: _measuring(scene, (ranges_of(scene.robot) + _TOO_FAR).astype(np.float32)),
    "angle_step": _angle_step,
    "mount": _mount,
    "laser_knocked": _laser_knocked,
    "scans_repeated": _scans_repeated,
    "glass": lambda scene: _measuring(scene, behind_glass(scene.robot, scene.world, scene.rng)),
    "people": lambda scene: _measuring(scene, with_people(scene.robot, scene.begin, scene.rng)),
    "crowd": lambda scene: _measuring(scene, within_a_crowd(scene.robot, scene.rng)),
    "furniture": _furniture,
    "carried": _carried,
    "lift": _lift,
}
"""All faults by name."""


def _odometry_at(robot: SimulatedRobot, stamp: float) -> SE2:
    clipped = np.clip([stamp], robot.odometry.stamps[0], robot.odometry.stamps[-1])
    return SE2.from_array(poses_at(robot.odometry, clipped)[0])


def _odometry_moved(robot: SimulatedRobot, since: float, T_new_old: SE2) -> SimulatedRobot:
    """Return the robot with its odometry in another frame from a time on."""
    poses = robot.odometry.poses.copy()
    late = robot.odometry.stamps >= since
    poses[late] = Trajectory(robot.odometry.stamps[late], poses[late]).transformed(T_new_old).poses
    return replace(robot, odometry=Trajectory(robot.odometry.stamps, poses))


def _restamped(robot: SimulatedRobot, stamps: FloatArray) -> SimulatedRobot:
    """Return the robot with other stamps in its scans; the times of recording stay."""
    stamps = np.round(stamps * 1e6) / 1e6
    readings = tuple(
        replace(reading, scan=replace(reading.scan, stamp=float(stamp)))
        for reading, stamp in zip(robot.readings, stamps, strict=True)
    )
    return replace(robot, readings=readings, truth=Trajectory(stamps, robot.truth.poses))


def _rescanned(robot: SimulatedRobot, changed: BoolArray, ranges: FloatArray) -> SimulatedRobot:
    """Return the robot with other ranges (S, B) in some scans (S,)."""
    readings = list(robot.readings)
    for index in np.flatnonzero(changed).tolist():
        readings[index] = replace(readings[index], scan=replace(readings[index].scan, ranges=ranges[index]))
    return replace(robot, readings=tuple(readings))


def _measuring(scene: _Scene, ranges: FloatArray) -> SimulatedRobot:
    """Return the robot with other ranges (S, B) in the scans of the time of the fault."""
    return _rescanned(scene.robot, scene.scans(), ranges)
