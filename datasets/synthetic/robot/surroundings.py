"""Surroundings besides fixed walls: glass, people and moved objects."""

import math

import numpy as np

from datasets.synthetic.robot.simulation import SimulatedRobot
from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.rays.ray_casting import cast_rays

_GLASS_SHARE, _PASSING = 0.15, 0.8  # of the walls, and of the beams that meet them
_LONG_WALL = 1.0  # [m]
_EVERY, _IN_SIGHT = 3.0, 8.0  # time between people who cross the path; time that each is in sight before and after [s]
_PERSON, _WALKING = 0.2, 1.0  # radius [m], speed [m/s]
_CROWD, _CROWD_FROM, _CROWD_TO, _ROUND = 5, 1.0, 2.0, 0.2  # people, distances [m], turn rate of their circle [rad/s]
_BOXES, _BOX = 12, 0.5  # number, side [m]
_POSTS = ((-1.05, 0.3, 0.03), (1.3, 0.45, 0.04))  # direction from the laser [rad], distance [m], radius [m]
_SHAKING = 0.01  # displacement of the posts of a driving robot [m]
_CABIN = 1.9  # side of a lift's cabin [m]
_KEPT_FREE = 0.7  # least distance of the robot from the middle of a box or a person [m]


def ranges_of(robot: SimulatedRobot) -> FloatArray:
    """Return the ranges (S, B) of all scans [m]."""
    return np.array([reading.scan.ranges for reading in robot.readings])


def behind_glass(robot: SimulatedRobot, world: World, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans where some of the long walls are of glass."""
    lengths = np.hypot(world.walls[:, 2] - world.walls[:, 0], world.walls[:, 3] - world.walls[:, 1])
    is_glass = (lengths > _LONG_WALL) & (rng.random(len(lengths)) < _GLASS_SHARE)
    seen = ranges_of(robot)
    if is_glass.all() or not is_glass.any():
        return seen
    others = World(world.name, world.seed, world.walls[~is_glass], world.places)
    scans = robot.laser.scans(others, robot.truth.stamps, robot.truth.poses, rng)
    through = np.array([scan.ranges for scan in scans])
    passes = (through > seen + 0.1) & (rng.random(seen.shape) < _PASSING)
    return np.where(passes, through, seen)


def with_people(robot: SimulatedRobot, since: float, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans; from a time on people cross the robot's path."""
    stamps, poses = robot.recorded, robot.truth.poses
    number = max(math.ceil((stamps[-1] - since) / _EVERY), 1)
    meetings = since + np.arange(number) * _EVERY
    met = np.searchsorted(stamps, meetings).clip(0, len(stamps) - 1)
    angles = rng.uniform(0.0, 2.0 * np.pi, (2, number))
    directions = np.stack((np.cos(angles[0]), np.sin(angles[0])), axis=1)
    passing = poses[met, :2] + 1.2 * np.stack((np.cos(angles[1]), np.sin(angles[1])), axis=1)
    things = []
    for stamp, pose in zip(stamps, poses, strict=True):
        there = np.abs(stamp - meetings) < _IN_SIGHT
        walked = passing[there] + directions[there] * (_WALKING * (stamp - meetings[there]))[:, None]
        aside = walked[np.hypot(*(walked - pose[:2]).T) > _KEPT_FREE]  # people keep clear of the robot
        things.append(np.vstack([np.zeros((0, 4)), *(_polygon(place, _PERSON, 8, 0.0) for place in aside)]))
    return _before(robot, things, rng)


def within_a_crowd(robot: SimulatedRobot, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans with people that accompany the robot at one or two metres."""
    phases, slow, speeds = rng.uniform(0.0, 2.0 * np.pi, (2, _CROWD)), *rng.uniform(-_ROUND, _ROUND, (2, _CROWD))
    things = []
    for stamp, pose in zip(robot.recorded, robot.truth.poses, strict=True):
        angles = phases[0] + speeds * (stamp - robot.recorded[0])
        swing = np.sin(phases[1] + slow * (stamp - robot.recorded[0]))
        distances = _CROWD_FROM + (_CROWD_TO - _CROWD_FROM) * (0.5 + 0.5 * swing)
        places = pose[:2] + distances[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)
        things.append(np.vstack([_polygon(place, _PERSON, 8, 0.0) for place in places]))
    return _before(robot, things, rng)


def behind_posts(robot: SimulatedRobot, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans with two posts of the robot itself in view, which shake a little."""
    places = [distance * np.array((math.cos(angle), math.sin(angle))) for angle, distance, _ in _POSTS]
    things = []
    for pose in robot.truth.poses:
        T_world_sensor = SE2.from_array(pose) @ robot.laser.T_robot_sensor
        shaken = [T_world_sensor.apply(place + rng.normal(0.0, _SHAKING, 2)) for place in places]
        things.append(np.vstack([_polygon(place, post[2], 8, 0.0) for place, post in zip(shaken, _POSTS, strict=True)]))
    return _before(robot, things, rng)


def with_moved_boxes(robot: SimulatedRobot, at: float, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans with boxes beside the path, which are moved at a time."""
    path = robot.truth.poses[::10, :2]
    places: list[FloatArray] = []
    while len(places) < 2 * _BOXES:
        place = path[rng.integers(len(path))] + rng.uniform(-2.0, 2.0, 2)
        if np.hypot(*(path - place).T).min() > _KEPT_FREE:
            places.append(place)
    boxes = [_polygon(place, _BOX / np.sqrt(2.0), 4, rng.uniform(0.0, np.pi)) for place in places]
    before, after = np.vstack(boxes[:_BOXES]), np.vstack(boxes[_BOXES:])
    return _before(robot, [before if stamp < at else after for stamp in robot.recorded], rng)


def in_a_cabin(robot: SimulatedRobot, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans with the walls of a closed cabin around the robot."""
    things = [_polygon(pose[:2], _CABIN / math.sqrt(2.0), 4, pose[2] + math.pi / 4.0) for pose in robot.truth.poses]
    return _before(robot, things, rng)


def _before(robot: SimulatedRobot, things: list[FloatArray], rng: np.random.Generator) -> FloatArray:
    """Return the ranges (S, B) of all scans with segments (N, 4) in front of the walls, others for each scan."""
    ranges = ranges_of(robot)
    scan = robot.readings[0].scan
    for index, walls in enumerate(things):
        sensor = np.array([SE2.from_array(robot.truth.poses[index]) @ robot.laser.T_robot_sensor])
        nearer = np.empty((1, ranges.shape[1]))
        cast_rays(walls, sensor, scan.angle_min, scan.angle_increment, robot.laser.range_max, nearer)
        nearer += rng.normal(0.0, robot.laser.noise, nearer.shape)
        ranges[index] = np.minimum(ranges[index], nearer[0].astype(np.float32))
    return ranges


def _polygon(centre: FloatArray, radius: float, corners: int, turn: float) -> FloatArray:
    """Return the sides (N, 4) of a regular polygon [m]."""
    angles = turn + np.arange(corners + 1) * 2.0 * np.pi / corners
    points = centre + radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return np.hstack((points[:-1], points[1:]))
