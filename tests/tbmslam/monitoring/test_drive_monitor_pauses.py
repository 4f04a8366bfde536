"""What changed while the laser was silent, and a robot that was lost after it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.world import World
from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.monitoring.drive_monitor import CHANGED, LOST, MOVED, DriveMonitor
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2
from tbmslam.slam import Slam
from tests.tbmslam.monitoring.monitored import carried, mapped, said


def room(length, width, stamp):
    """What a laser in the middle of an empty room sees."""
    angles = np.radians(np.arange(-180.0, 180.0) + 0.5)
    ranges = np.minimum(length / 2.0 / np.abs(np.cos(angles)), width / 2.0 / np.abs(np.sin(angles)))
    return LaserScan(stamp, float(angles[0]), math.radians(1.0), 0.1, 30.0, ranges)


def settled_by(monitor, metres, scan):
    """Let a keyframe be moved after its scan was checked, as where people held the robot back."""
    checked = monitor.checked(scan, ScanMatch(SE2.identity(), 0.9, moved=True), SE2.identity(), 0.0)
    settled = checked.T_map_sensor @ SE2(metres, 0.0, 0.0)
    monitor.note_keyframe(Reading(scan, None), settled)
    return settled


@pytest.mark.parametrize("metres", [0.0, 0.12, 0.4])
def test_what_is_compared_after_a_pause_is_the_place_that_was_settled_on(metres):
    config = Slam().config
    for sides, told in (((6.0, 12.0), []), ((12.0, 6.0), [LOST])):
        monitor = DriveMonitor(config.continuity, config.blocked_beams, config.odometry_check)
        settled = settled_by(monitor, metres, room(6.0, 12.0, 0.0))
        monitor.checked(room(*sides, 2.0), ScanMatch(settled, 0.9, moved=True), settled, 0.0)
        assert [incident.what for incident in monitor.incidents] == told


def test_a_lost_robot_goes_on_from_where_it_was_expected():
    config = Slam().config
    monitor = DriveMonitor(config.continuity, config.blocked_beams, config.odometry_check)
    monitor.checked(room(6.0, 12.0, 0.0), ScanMatch(SE2.identity(), 0.9, moved=True), SE2.identity(), 0.0)
    astray = ScanMatch(SE2(0.45, 0.4, 0.5), 0.1, moved=True)
    assert monitor.checked(room(12.0, 6.0, 0.1), astray, SE2.identity(), 0.0) is None
    assert (
        monitor.checked(room(12.0, 6.0, 0.2), ScanMatch(SE2.identity(), 0.1, moved=True), SE2.identity(), 0.0)
        is not None
    )


def paused(readings, at, seconds):
    """Switch the laser off for a while, in which the robot stands still."""
    return [replace(r, scan=replace(r.scan, stamp=r.scan.stamp + seconds * (k >= at))) for k, r in enumerate(readings)]


def test_a_pause_in_which_nothing_changes_is_no_incident(robot):
    slam, drive = mapped(paused(robot.readings, 60, 600.0))
    assert said(slam) == []
    assert len(drive.trajectory) == len(robot.readings)


def test_a_corridor_alike_everywhere_gives_a_carried_robot_away_by_what_changed_in_a_pause(robot):
    """Scans fit in some way all the same, which says nothing where the wheels stood still."""
    readings = paused(carried(robot, 60, 66), 61, 2.0)
    slam, _ = mapped(readings)
    (told,) = [i for i in slam.incidents if i.what in (LOST, CHANGED)]
    assert told.stamp == readings[61].scan.stamp


def bare_corridor(poses, pitch=4.0):
    """Let a robot look around a corridor with shallow doors, alike everywhere, from some poses."""
    xs = np.arange(-40.0, 40.0, pitch)
    low = np.array([(x, -0.16, x + 0.95, -0.16) for x in xs] + [(x + 0.95, 0.0, x + pitch, 0.0) for x in xs])
    sides = np.array([(x + end, 0.0, x + end, -0.16) for x in xs for end in (0.0, 0.95)])
    walls = np.vstack((low, sides))
    walls = np.vstack((walls, walls * (1.0, -1.0, 1.0, -1.0) + np.array((0.0, 2.2, 0.0, 2.2))))
    angle_min, step = SimulatedLaser.field_of(361)
    laser = SimulatedLaser(
        beams=361, angle_min=angle_min, angle_increment=step, range_max=10.0, T_robot_sensor=SE2.identity()
    )
    return laser.scans(
        World("bare", 0, walls, np.zeros((1, 2))),
        np.arange(len(poses)) * 0.2,
        np.array(poses),
        np.random.default_rng(1),
    )


@pytest.mark.parametrize(
    ("carried", "told"),
    [
        ((0.0, 0.0, 0.0), []),
        ((1.9, 0.0, 0.0), [CHANGED]),  # doors of 16 cm where walls were
        ((4.0, 0.08, 0.0), [MOVED]),
        ((4.0, 0.0, 0.02), [CHANGED]),
        ((4.0, 0.0, 0.0), []),  # nothing in the whole drive tells
    ],
)
def test_a_corridor_alike_everywhere_tells_of_all_but_what_is_alike(carried, told):
    way = [(0.1 * k, 1.1, 0.0) for k in range(30)]
    poses = [*way[:15], *(tuple(np.add(pose, carried)) for pose in way[15:])]
    readings = [
        Reading(replace(scan, stamp=scan.stamp + 20.0 * (k >= 15)), SE2(*way[k]))
        for k, scan in enumerate(bare_corridor(poses))
    ]
    slam, _ = mapped(readings)
    assert [incident.what for incident in slam.incidents if incident.stamp == readings[15].scan.stamp] == told


def test_small_changes_in_a_pause_are_told_and_cut_nothing(robot):
    readings = paused(carried(robot, 60, 62), 61, 2.0)
    slam, drive = mapped(readings)
    assert [i.what for i in slam.incidents] == [CHANGED]
    assert len(drive.trajectory) == len(readings)
