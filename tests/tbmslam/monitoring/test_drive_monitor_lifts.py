"""Lifts in drives: each floor is a part of its own, and what only looks like a lift cuts nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.world import World
from tbmslam.laser_scan import Reading
from tbmslam.monitoring.drive_monitor import ALIKE, DOUBTFUL, ELSEWHERE
from tbmslam.se2 import SE2
from tbmslam.slam import Slam
from tests.lift_ride import OTHER_ROOMS, ROOMS, floor, ride
from tests.tbmslam.monitoring.monitored import mapped, said


def within(readings, begin, end):
    """What --interval leaves of a drive."""
    start = readings[0].scan.stamp
    return [r for r in readings if begin <= r.scan.stamp - start <= end]


def test_a_lift_ends_a_part_of_the_drive_and_each_part_is_a_robot_of_its_own(caplog):
    readings, (closed, opened) = ride(floor(ROOMS), floor(OTHER_ROOMS, 2.8))
    slam, drive = mapped(readings)
    (lift, left_out) = slam.incidents
    assert lift.what == ELSEWHERE
    assert closed - 1.0 < lift.stamp < closed + 1.0
    assert opened - 1.0 < lift.stamp + lift.seconds < opened + 1.0
    assert any("shut in as in a lift, and what it saw when it came out is another place" in m for m in caplog.messages)
    assert "left out of the map, make a robot of it by --interval" in left_out.what
    begin, end = (float(number) for number in left_out.what.split()[-2:])
    rest = within(readings, begin, end)
    assert len(rest) + len(drive.trajectory) == pytest.approx(len(readings), abs=1)
    other, _ = mapped(rest)
    assert said(other) == []
    kept, again = mapped([r for r in readings if r.scan.stamp in set(drive.trajectory.stamps.tolist())])
    assert said(kept) == []
    true = {r.scan.stamp: r.T_odom_robot for r in readings}
    for way in (drive, again):
        first = true[way.trajectory.stamps[0]].to(true[way.trajectory.stamps[-1]])
        assert way.trajectory.pose(0).to(way.trajectory.pose(len(way.trajectory) - 1)) == pytest.approx(first, abs=0.05)


WIDE_ROOMS = ((-6.0, -3.5, 3.0), (-1.0, 1.0, 2.5), (4.0, 6.5, 2.5))


@pytest.mark.parametrize(("before", "after"), [(ROOMS, WIDE_ROOMS), (OTHER_ROOMS, ROOMS), (OTHER_ROOMS, WIDE_ROOMS)])
def test_walls_of_another_floor_are_no_parts_of_the_robot(before, after):
    """Going in backwards and out ahead, without a turn, the laser sees them where it saw through on the first floor."""
    slam, _ = mapped(ride(floor(before), floor(after), 12.0, backwards=True)[0])
    assert [i.what.partition(",")[0] for i in slam.incidents] == ["shut in as in a lift", "left out of the map"]


@pytest.mark.parametrize("since", [0.0, 30.0])
def test_a_part_of_the_robot_is_told_once_however_it_takes_a_lift(since):
    """Known before the lift or shown only after it."""
    readings, (_, opened) = ride(floor(OTHER_ROOMS), floor(ROOMS), 12.0, backwards=True)
    start = readings[0].scan.stamp
    posts = (np.abs(np.arange(361) - 60) < 6) | (np.abs(np.arange(361) - 300) < 6)
    seen = [np.where(posts & (r.scan.stamp >= start + since), 0.6, r.scan.ranges) for r in readings]
    slam, _ = mapped([replace(r, scan=r.scan.with_ranges(s)) for r, s in zip(readings, seen, strict=True)])
    (blocks,) = [i for i in slam.incidents if "blocks" in i.what]
    assert "blocks 6% of the beams, -63 to -58, 57 to 62°" in blocks.what
    assert (blocks.stamp > opened - 10.0) == (since > 0.0)
    assert [i.what for i in slam.incidents].count(ELSEWHERE) == 1


def test_a_part_of_the_robot_is_told_within_two_metres_though_it_stood_where_all_is_near():
    """What it sees where it stands is no other floor: only what it saw before may be."""
    corners = np.array([(-0.6, -1.5), (2.6, -1.5), (2.6, 1.5), (-0.6, 1.5), (-0.6, -1.5)])
    world = World("room", 0, np.hstack((corners[:-1], corners[1:])), np.zeros((1, 2)))
    laser = SimulatedLaser(
        beams=361, angle_min=-math.pi / 2, angle_increment=math.pi / 360, T_robot_sensor=SE2.identity()
    )
    x = np.concatenate((np.zeros(60), np.arange(0.0, 1.7, 0.06)))
    poses = np.column_stack((x, np.zeros_like(x), np.zeros_like(x)))
    scans = laser.scans(world, 1000.0 + 0.2 * np.arange(len(x)), poses, np.random.default_rng(1))
    posts = (np.abs(np.arange(361) - 60) < 6) | (np.abs(np.arange(361) - 300) < 6)
    slam, _ = mapped(
        Reading(scan.with_ranges(np.where(posts, 0.4, scan.ranges)), SE2.from_array(pose))
        for scan, pose in zip(scans, poses, strict=True)
    )
    assert slam._monitor._shut_in.left is not None
    (blocks,) = slam.incidents
    assert "blocks 6% of the beams, -63 to -58, 57 to 62°" in blocks.what


def test_a_lift_to_a_floor_that_looks_alike_is_told_and_cuts_nothing():
    closed_rooms = floor(((-6.0, -5.0, 0.1),))
    open_rooms = floor(((-6.0, -5.0, 0.1), (-2.0, 2.0, 2.5)))
    slam, drive = mapped(ride(closed_rooms, open_rooms)[0])
    assert [i.what for i in slam.incidents] == [DOUBTFUL]
    assert "by --interval" in DOUBTFUL
    assert len(drive.trajectory) == len(slam._stamps)


def test_a_door_shut_behind_a_robot_is_told_and_cuts_nothing_where_all_is_as_before():
    slam, drive = mapped(ride(floor(ROOMS), floor(ROOMS))[0])
    assert [i.what for i in slam.incidents] == [ALIKE]
    assert "fits what was before" in ALIKE
    assert len(drive.trajectory) == len(slam._stamps)


def test_a_lift_at_the_end_of_a_drive_is_told_when_it_is_finished():
    readings, (_, opened) = ride(floor(ROOMS), floor(OTHER_ROOMS, 2.8))
    slam, drive = mapped([r for r in readings if r.scan.stamp < opened + 3.0])
    assert next(i.what for i in slam.incidents) == ELSEWHERE
    assert drive.trajectory.stamps[-1] < opened


@pytest.mark.parametrize("rest", [2, 60])
def test_a_lift_is_cut_where_it_was_though_the_clock_is_set_back_after_it(rest):
    readings, (closed, opened) = ride(floor(ROOMS), floor(OTHER_ROOMS, 2.8))
    begin = next(k for k, r in enumerate(readings) if r.scan.stamp >= opened + 2.0)
    earlier = [replace(r, scan=replace(r.scan, stamp=r.scan.stamp - 500.0)) for r in readings[begin : begin + rest]]
    slam, drive = mapped([*readings[:begin], *earlier])
    assert next(i.what for i in slam.incidents) == ELSEWHERE
    assert closed < drive.trajectory.stamps[-1] < opened


def test_nobody_looks_for_lifts_who_is_told_not_to():
    readings, _ = ride(floor(ROOMS), floor(OTHER_ROOMS, 2.8))
    config = Slam().config
    shut_in = config.continuity.shut_in.model_copy(update={"enabled": False})
    continuity = config.continuity.model_copy(update={"shut_in": shut_in})
    slam = Slam(config.model_copy(update={"continuity": continuity}))
    for reading in readings:
        slam.process(reading)
    assert len(slam.finish().drives[0].trajectory) == len(readings)
    assert said(slam) == []
