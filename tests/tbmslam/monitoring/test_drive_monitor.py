"""What goes wrong in drives: a right map, or a warning that names the time."""

import logging
import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.laser import SimulatedLaser
from datasets.synthetic.simulation import poses_at
from datasets.synthetic.world import World
from tbmslam.evaluation.trajectory_errors import absolute_errors
from tbmslam.laser_scan import LaserScan, Reading
from tbmslam.monitoring.drive_monitor import ALIKE, CHANGED, DOUBTFUL, ELSEWHERE, LOST, MOVED, DriveMonitor
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2
from tbmslam.slam import Slam
from tests.lift_ride import OTHER_ROOMS, ROOMS, floor, ride


@pytest.fixture
def robot(drive_in):
    return drive_in("apartment", 30.0, odometry="good")


def mapped(readings):
    slam = Slam()
    for reading in readings:
        slam.process(reading)
    return slam, slam.finish().drives[0]


def said(slam):
    return [incident.text(slam.started) for incident in slam.incidents]


def test_an_ordinary_drive_has_no_incident(robot):
    slam, _ = mapped(robot.readings)
    assert said(slam) == []


def carried(robot, begin, end):
    """Carry the robot on from one reading to a later one while its wheels stand still."""
    before, after = robot.readings[begin].T_odom_robot, robot.readings[end].T_odom_robot
    moved = [replace(r, T_odom_robot=before @ after.inverse() @ r.T_odom_robot) for r in robot.readings[end:]]
    return [*robot.readings[: begin + 1], *moved]


def test_a_robot_that_was_carried_elsewhere_gives_the_map_of_its_longest_part(robot, caplog):
    readings = carried(robot, 60, 120)
    slam, drive = mapped(readings)
    (left_out, lost) = [i for i in slam.incidents if i.what == LOST or "left out" in i.what]
    assert lost.what == LOST
    assert lost.stamp == readings[61].scan.stamp
    assert left_out.stamp == readings[0].scan.stamp
    assert "make a robot of it by --interval 0.00 12.0" in left_out.what
    assert len(drive.trajectory) == len(readings) - 61
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    assert any(LOST in line for line in caplog.messages)
    assert drive.keyframes.stamps[0] == readings[61].scan.stamp


def test_what_is_left_out_and_no_interval_names_is_to_be_a_file_of_its_own(robot):
    readings = carried(robot, 60, 120)
    back = [replace(r, scan=replace(r.scan, stamp=r.scan.stamp - 20.0 * (k >= 30))) for k, r in enumerate(readings)]
    slam, drive = mapped(back)
    (left_out,) = [i.what for i in slam.incidents if "left out" in i.what]
    assert len(drive.trajectory) == len(readings) - 61
    assert "no --interval names it: write its 61 scans into a file of their own, and map that" in left_out


def test_what_is_left_out_is_told_anew_each_time_a_drive_is_finished(robot):
    """The part that is left out at first may turn out to be the longest."""
    readings, slam = carried(robot, 60, 120), Slam()
    for reading in readings[:80]:
        slam.process(reading)
    told = []
    for _ in range(2):
        assert len(slam.finish().drives[0].trajectory) == 61
        told.append(said(slam))
    assert told[0] == told[1]
    assert sum("left out" in one and "--interval 24.0" in one for one in told[0]) == 1
    for reading in readings[80:]:
        slam.process(reading)
    assert not any("left out" in one for one in said(slam))
    slam.finish()
    assert said(slam) == said(mapped(readings)[0])


def test_times_are_told_from_where_the_recording_began(robot):
    readings = carried(robot, 60, 120)
    slam = Slam(started=readings[0].scan.stamp - 100.0)
    for reading in readings:
        slam.process(reading)
    slam.finish()
    assert any("make a robot of it by --interval 100.00 112.01" in incident.what for incident in slam.incidents)
    assert all(text.startswith("at 1") for text in said(slam))


def test_the_laser_unplugged_for_a_while_costs_only_that_while(robot):
    readings = [*robot.readings[:60], *robot.readings[130:]]
    slam, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert not any(i.what == LOST for i in slam.incidents)
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.3


def test_odometry_that_jumps_is_told_and_does_no_harm(robot):
    far = SE2(1e7, 0.0, 0.0)
    readings = [
        r if k < 60 else replace(r, T_odom_robot=(far if k == 60 else SE2(1.0, 2.0, 1.0)) @ r.T_odom_robot)
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    assert any("at 12.0 s: the odometry steps by 10000000 m, which is not believed" in line for line in said(slam))
    assert any("the odometry jumps" in line for line in said(slam))


def test_covered_beams_do_not_end_up_in_the_map(robot):
    readings = []
    for reading in robot.readings:
        ranges = reading.scan.ranges.copy()
        ranges[40:80] = 0.3
        readings.append(replace(reading, scan=replace(reading.scan, ranges=ranges)))
    slam, drive = mapped(readings)
    assert any(
        "at 0.0 s: something on the robot, or along with it, blocks 22% of the beams, -50 to -11°" in line
        for line in said(slam)
    )
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.2
    kept = np.concatenate([drive.keyframes.scan(k).ranges for k in range(len(drive.keyframes))])
    assert not (np.abs(kept - 0.3) < 1e-6).any()


def test_many_incidents_are_not_all_said(robot, caplog):
    slam = Slam(name="robot_7")
    for number in range(30):
        slam.incidents.add(100.0 * number, f"incident {number}")
    slam.process(robot.readings[0])
    with caplog.at_level(logging.WARNING):
        slam.finish()
    assert len(caplog.messages) == 21
    assert caplog.messages[-1] == "robot_7: and 10 more"


def test_odometry_in_a_bag_that_stops_for_a_while(robot):
    stamps = robot.truth.stamps
    odometry = poses_at(robot.odometry, stamps)
    readings = [
        Reading(r.scan, None if 40 <= k < 110 else SE2.from_array(pose), r.T_robot_sensor)
        for k, (r, pose) in enumerate(zip(robot.readings, odometry, strict=True))
    ]
    _, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.2


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


def test_odometry_that_freezes_is_told_and_scans_alone_tell_the_motion(robot):
    stopped = robot.readings[60].T_odom_robot
    last = robot.readings[120].T_odom_robot
    readings = [
        r if k < 60 else replace(r, T_odom_robot=stopped @ last.inverse() @ (last if k < 120 else r.T_odom_robot))
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert absolute_errors(robot.truth, drive.trajectory, 0.01).errors_m.max() < 0.1
    assert any(i.what.startswith("the odometry stands still while the robot moves") for i in slam.incidents)


def test_ranges_that_are_scaled_are_told_by_the_odometry(robot):
    readings = [replace(r, scan=r.scan.with_ranges(1.1 * r.scan.ranges)) for r in robot.readings]
    slam, _ = mapped(readings)
    slam.finish()
    (told,) = [line for line in said(slam) if "scale" in line]
    assert told.startswith("the scans go 1.1")
    assert told.endswith("times as far as the odometry, one of them has a wrong scale")


@pytest.mark.parametrize("seed", [3, 6])
def test_another_floor_from_one_scan_to_the_next_is_no_continuation(robot, drive_in, seed):
    """As when a lift's door opens: little contradicts, and nothing agrees."""
    other = drive_in("halls", 30.0, odometry="good", seed=seed)
    there, first, last = other.readings, other.readings[0], robot.readings[60]
    moved = last.T_odom_robot @ first.T_odom_robot.inverse()
    later = last.scan.stamp + 0.2 - first.scan.stamp
    readings = [
        *robot.readings[:61],
        *(
            replace(r, scan=replace(r.scan, stamp=r.scan.stamp + later), T_odom_robot=moved @ r.T_odom_robot)
            for r in there
        ),
    ]
    slam, drive = mapped(readings)
    (lost,) = [i for i in slam.incidents if i.what == LOST]
    assert lost.stamp == readings[61].scan.stamp
    assert len(drive.trajectory) == len(there)


def test_a_hand_before_the_laser_is_a_continuation(robot):
    readings = [
        replace(r, scan=r.scan.with_ranges(np.where(np.arange(181) < 160, 0.4, r.scan.ranges))) if 60 <= k < 63 else r
        for k, r in enumerate(robot.readings)
    ]
    slam, drive = mapped(readings)
    assert len(drive.trajectory) == len(readings)
    assert not any(i.what == LOST for i in slam.incidents)


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
