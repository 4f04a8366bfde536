"""A robot that takes a lift: along a corridor into a cabin, shut in for a while, and out onto a floor."""

import math

import numpy as np

from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.world import World
from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.se2 import SE2

RATE, SPEED, TURN_RATE = 5.0, 0.5, 0.6
ROOMS = ((-6.0, -3.5, 3.0), (-1.5, 2.0, 1.5), (4.0, 6.5, 2.5))
OTHER_ROOMS = ((-7.0, -5.5, 1.5), (-3.0, -0.5, 3.0), (1.5, 3.0, 2.0), (5.0, 7.0, 1.5))
MIDDLE = -2.3  # the corridor's [m]
CABIN = np.array(
    [
        (-0.5, -1.0, -1.0, -1.0),
        (-1.0, -1.0, -1.0, 1.0),
        (-1.0, 1.0, 1.0, 1.0),
        (1.0, 1.0, 1.0, -1.0),
        (1.0, -1.0, 0.5, -1.0),
    ]
)
DOOR = np.array([(-0.5, -1.05, 0.5, -1.05)])


def floor(rooms, width=2.2, half=9.0):
    """A corridor before the cabin's door, with rooms (from x, to x, depth) open to it on its other side."""
    north, south = -1.1, -1.1 - width
    corners = [(0.5, north), (half, north), (half, south)]
    for begin, end, depth in reversed(rooms):
        corners += [(end, south), (end, south - depth), (begin, south - depth), (begin, south)]
    corners += [(-half, south), (-half, north), (-0.5, north)]
    return np.vstack((np.hstack((corners[:-1], corners[1:])), CABIN))


def way(seconds, backwards=False):
    """Return the robot's poses (N, 3), and from which to which the doors are closed."""
    poses = [(-7.0, MIDDLE, 0.0)]

    def drive_to(x, y):
        begin = poses[-1]
        number = math.ceil(math.hypot(x - begin[0], y - begin[1]) / SPEED * RATE)
        poses.extend(
            (*(begin[i] + ((x, y)[i] - begin[i]) * k / number for i in (0, 1)), begin[2]) for k in range(1, number + 1)
        )

    def turn_by(angle):
        x, y, theta = poses[-1]
        number = math.ceil(abs(angle) / TURN_RATE * RATE)
        poses.extend((x, y, theta + angle * k / number) for k in range(1, number + 1))

    drive_to(0.0, MIDDLE)
    turn_by(math.pi / (-2.0 if backwards else 2.0))
    drive_to(0.0, 0.0)
    turn_by(0.0 if backwards else math.pi)
    closed = len(poses)
    poses.extend([poses[-1]] * round(seconds * RATE))
    opened = len(poses)
    poses.extend([poses[-1]] * 3)
    drive_to(0.0, MIDDLE)
    turn_by(math.pi / 2.0)
    drive_to(7.0, MIDDLE)
    return np.array(poses), closed, opened


def ride(before, after, seconds=20.0, beams=361, door=True, backwards=False):
    """Return the readings of a robot that goes in on one floor and comes out on another, and when it is shut in.

    Parameters
    ----------
    before, after
        Walls (N, 4) of the floors; one and the same for a closet with a door.
    seconds
        How long it stands.
    door
        Whether the door is closed meanwhile.
    backwards
        Whether it goes in backwards, and comes out as it stands.
    """
    poses, closed, opened = way(seconds, backwards)
    angle_min, step = SimulatedLaser.field_of(beams)
    laser = SimulatedLaser(
        beams=beams, angle_min=angle_min, angle_increment=step, range_max=10.0, T_robot_sensor=SE2.identity()
    )
    stamps, rng = 1000.0 + np.arange(len(poses)) / RATE, np.random.default_rng(3)
    shut = before if not door else np.vstack((before, DOOR))
    scans: list[LaserScan] = []
    for walls, begin, end in ((before, 0, closed), (shut, closed, opened), (after, opened, len(poses))):
        world = World("floor", 0, walls, np.zeros((1, 2)))
        scans += laser.scans(world, stamps[begin:end], poses[begin:end], rng)
    start = SE2.from_array(poses[0]).inverse()
    readings = [Reading(scan, start @ SE2.from_array(pose)) for scan, pose in zip(scans, poses, strict=True)]
    return readings, (float(stamps[closed]), float(stamps[opened]))
