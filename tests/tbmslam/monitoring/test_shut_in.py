"""Whether a robot that was shut in came out where it had gone in."""

from dataclasses import replace

import numpy as np
import pytest

from tbmslam.monitoring.shut_in import ShutIn, ShutInConfig
from tests.lift_ride import OTHER_ROOMS, ROOMS, floor, ride

FLOOR, OTHER, ALIKE = floor(ROOMS), floor(OTHER_ROOMS, 2.8), floor(OTHER_ROOMS)


def watched(readings, config=None):
    """Feed a watch with true poses; return it and what it found, with the stamp at which it did."""
    watch, found = ShutIn(config or ShutInConfig()), []
    for number, reading in enumerate(readings):
        pose = reading.T_odom_robot
        found.append((reading.scan.stamp, watch.look(reading.scan, pose, pose)))
        if number % 3 == 0:
            found.append((reading.scan.stamp, watch.note_keyframe(reading.scan, pose, pose)))
    found.append((readings[-1].scan.stamp, watch.end()))
    return watch, [(stamp, coming) for stamp, coming in found if coming is not None]


@pytest.mark.parametrize("beams", [181, 361, 1040])
@pytest.mark.parametrize("seconds", [6.0, 20.0])
def test_another_floor_is_told_within_metres(beams, seconds):
    readings, (closed, opened) = ride(FLOOR, OTHER, seconds, beams)
    watch, ((stamp, found),) = watched(readings)
    assert watch.left == found.stay
    assert found.elsewhere
    assert found.stay.closed
    assert closed - 1.0 <= found.stay.since <= closed + 1.0
    assert opened - 1.0 <= found.stay.until <= opened
    assert stamp < opened + 15.0


@pytest.mark.parametrize("seconds", [6.0, 20.0, 60.0])
def test_where_all_is_as_before_only_the_shut_door_is_told(seconds):
    """It may be a closet, or a lift to a floor alike."""
    readings, (_, opened) = ride(FLOOR, FLOOR, seconds)
    _, ((_, found),) = watched(readings)
    assert (found.elsewhere, found.differs) == (False, False)
    assert found.stay.closed
    assert watched([r for r in readings if r.scan.stamp < opened + 1.0])[1] == []  # it has seen too little by then


def test_a_floor_with_the_same_corridor_is_told_by_its_rooms():
    _, ((_, found),) = watched(ride(FLOOR, ALIKE)[0])
    assert found.stay.closed


def test_walls_that_are_only_gone_are_told_and_cut_nothing():
    closed_rooms = floor(((-6.0, -5.0, 0.1),))
    open_rooms = floor(((-6.0, -5.0, 0.1), (-2.0, 2.0, 2.5)))
    _, found = watched(ride(closed_rooms, open_rooms)[0])
    assert [(coming.elsewhere, coming.differs) for _, coming in found] == [(False, True)]


def test_standing_for_less_than_a_ride_takes_is_nothing():
    watch, found = watched(ride(FLOOR, OTHER, 2.0)[0])
    assert (watch.left, found) == (None, [])


def test_without_the_door_seen_it_takes_longer_and_more():
    """The corridor's other wall is within what counts as near: as from a cabin that the robot faces all the time."""
    config = ShutInConfig(near=8.0)
    assert watched(ride(FLOOR, OTHER, 2.0, door=False)[0], config)[1] == []
    _, ((_, found),) = watched(ride(FLOOR, OTHER, 20.0, door=False)[0], config)
    assert found.elsewhere
    assert not found.stay.closed
    assert watched(ride(FLOOR, FLOOR, 20.0, door=False)[0], config)[1] == []


def test_a_hand_before_the_laser_is_no_lift():
    readings, (closed, opened) = ride(FLOOR, FLOOR, door=False)
    covered = [
        replace(r, scan=r.scan.with_ranges(np.full(len(r.scan.ranges), 0.3))) if closed <= r.scan.stamp < opened else r
        for r in readings
    ]
    assert watched(covered)[1] == []


def test_at_the_end_of_the_drive_what_is_known_decides():
    readings, (_, opened) = ride(FLOOR, OTHER)
    watch, found = watched([r for r in readings if r.scan.stamp < opened + 3.0])
    assert [coming.elsewhere for _, coming in found] == [True]
    assert watch.end() is None


def test_a_drive_that_begins_shut_in_knows_no_place_before():
    readings, (closed, _) = ride(FLOOR, OTHER)
    assert watched([r for r in readings if r.scan.stamp > closed + 0.5])[1] == []


def test_a_robot_that_got_lost_has_nothing_to_compare_with():
    readings, (_, opened) = ride(FLOOR, OTHER)
    watch = ShutIn(ShutInConfig())
    for reading in readings:
        pose = reading.T_odom_robot
        assert watch.look(reading.scan, pose, pose) is None
        if reading.scan.stamp >= opened + 1.0:
            watch.forget()
        assert watch.note_keyframe(reading.scan, pose, pose) is None
    assert watch.end() is None


def test_beams_that_say_nothing_are_not_near():
    readings, _ = ride(FLOOR, OTHER)
    blind = [replace(r, scan=r.scan.with_ranges(np.full(len(r.scan.ranges), np.nan))) for r in readings]
    assert watched(blind)[1] == []


def test_of_two_stays_the_one_seen_shut_counts():
    """A while before, the robot stood before a wall for long; what was before that is as good."""
    readings, (closed, _) = ride(FLOOR, OTHER, 6.0)
    first = readings[10]
    wall = first.scan.with_ranges(np.minimum(first.scan.ranges, 1.5))
    waiting = [replace(first, scan=replace(wall, stamp=first.scan.stamp + 0.2 * k)) for k in range(1, 80)]
    later = [replace(r, scan=replace(r.scan, stamp=r.scan.stamp + 16.0)) for r in readings[11:]]
    _, found = watched([*readings[:11], *waiting, *later])
    (cut,) = [coming for _, coming in found if coming.elsewhere]
    assert cut.stay.since == pytest.approx(closed + 16.0, abs=1.0)


def test_a_lift_that_stops_on_the_way_is_told_twice():
    """The doors open for two seconds onto a floor that the robot sees from the cabin only."""
    (first, (_, opened)), (second, (closed, _)) = ride(FLOOR, OTHER), ride(OTHER, floor(ROOMS, 5.0))
    peek = [r for r in first if r.scan.stamp < opened + 2.0]
    later = peek[-1].scan.stamp + 0.2 - closed
    rest = [replace(r, scan=replace(r.scan, stamp=r.scan.stamp + later)) for r in second if r.scan.stamp >= closed]
    _, found = watched([*peek, *rest])
    assert [coming.elsewhere for _, coming in found] == [True, True]
    assert found[0][1].stay.until < opened < found[1][1].stay.since


def test_a_ride_soon_after_a_longer_stay_is_told_once():
    """The robot waits in the cabin while its door opens again onto the same floor."""
    (first, (_, opened)), (second, (closed, _)) = ride(FLOOR, FLOOR, 30.0), ride(FLOOR, OTHER, 8.0)
    waits = [r for r in first if r.scan.stamp < opened + 2.0]
    later = waits[-1].scan.stamp + 0.2 - closed
    rest = [replace(r, scan=replace(r.scan, stamp=r.scan.stamp + later)) for r in second if r.scan.stamp >= closed]
    _, found = watched([*waits, *rest])
    assert found[0][1].elsewhere
    assert len(found) == 1
