import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.blocked_beams import BlockedBeams, BlockedBeamsConfig
from tbmslam.sensing.laser_scan import LaserScan

rng = np.random.default_rng(0)


def scan(k, ranges):
    return LaserScan(float(k), -1.0, 0.02, 0.02, 30.0, np.asarray(ranges))


def drive(ranges_of, steps=40, turning=True):
    """Drive 0.3 m a step through surroundings, on a winding way."""
    beams, found = BlockedBeams(BlockedBeamsConfig()), []
    for k in range(steps):
        pose = SE2(0.3 * k, 0.0, 0.8 * np.sin(0.5 * k) if turning else 0.0)
        if beams.look(scan(k, ranges_of(k)), pose):
            found.append(k)
    return beams, found


def open_space(k):
    return rng.uniform(2.0, 8.0, 100)


def covered(k, until=1000):
    ranges = open_space(k)
    if 5 <= k < until:
        ranges[20:50] = 0.25 + rng.normal(0.0, 0.003, 30)
    return ranges


def test_a_cover_is_found_soon_and_taken_out():
    beams, found = drive(covered)
    assert 6 <= found[0] <= 11
    assert np.flatnonzero(beams.blocked).tolist() == list(range(20, 50))
    cleaned = beams.without(scan(50, covered(50)))
    assert np.isnan(cleaned.ranges[20:50]).all()
    assert np.isfinite(np.delete(cleaned.ranges, np.s_[20:50])).all()


def test_earlier_scans_are_cleared_afterwards_but_not_those_before_the_cover():
    beams, _ = drive(lambda k: covered(k, until=30))
    assert not beams.blocked.any()
    for k, hidden in ((4, 0), (5, 30), (20, 30), (30, 0), (35, 0)):
        assert np.isnan(beams.cleared(scan(k, open_space(k))).ranges).sum() == hidden


def test_a_beam_that_sees_far_again_says_so_at_once():
    beams, _ = drive(covered)
    assert np.isfinite(beams.without(scan(50, open_space(50))).ranges).all()


@pytest.mark.parametrize(
    ("ranges_of", "turning"),
    [
        (lambda _: np.full(100, 0.8), False),  # along a wall
        (lambda _: np.full(100, 1.5), True),  # a round room, or a bug, but not on the robot
        (lambda _: np.where(np.arange(100) % 7 == 0, 0.25, 5.0), True),  # single beams
        (lambda _: np.full(100, np.inf), True),
        (open_space, True),
    ],
)
def test_what_is_no_cover(ranges_of, turning):
    beams, found = drive(ranges_of, turning=turning)
    assert found == []
    same = scan(50, ranges_of(50))
    assert beams.without(same) is same
    assert beams.cleared(same) is same


def test_what_is_very_near_and_does_not_change_is_not_believed_for_now():
    beams, found = drive(lambda _: np.where(np.arange(100) < 30, 0.25, 5.0), steps=3, turning=False)
    assert found == []
    assert np.isnan(beams.without(scan(3, np.full(100, 0.25))).ranges).sum() == 30
    assert np.isfinite(beams.without(scan(3, np.full(100, 0.4))).ranges).all()


@pytest.mark.parametrize("reach", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("world", ["office", "apartment"])
def test_a_laser_that_sees_near_things_alone_has_nothing_in_view(drive_in, world, reach):
    """Between two walls that happen to be as far it sees nothing, which is no proof that it saw the same thing."""
    beams = BlockedBeams(BlockedBeamsConfig())
    for reading in drive_in(world, 60.0, "good", seed=2, beams=361).readings:
        ranges = np.where(reading.scan.ranges > reach, np.inf, reading.scan.ranges)
        assert not beams.look(reading.scan.with_ranges(ranges), reading.T_odom_robot)
    assert not beams.were_any()


@pytest.mark.parametrize("lost", [0.0, 0.5, 0.8])
def test_a_cover_that_seldom_returns_takes_longer_to_be_found(lost):
    def seldom(k):
        return np.where(rng.random(100) < lost * (np.abs(np.arange(100) - 35) <= 15), np.inf, covered(k))

    _, found = drive(seldom, steps=60)
    assert 6 <= found[0] <= 8.0 / (1.0 - lost) + 5.0


def test_a_standing_robot_tells_nothing():
    beams = BlockedBeams(BlockedBeamsConfig())
    assert not any(beams.look(scan(k, covered(9)), SE2.identity()) for k in range(50))


def test_another_number_of_beams_begins_anew():
    beams, _ = drive(covered)
    other = scan(50, np.full(60, 0.25))
    assert not beams.look(other, SE2(99.0, 0.0, 0.0))
    assert beams.without(other) is other
    assert np.isnan(beams.cleared(scan(20, covered(20))).ranges).sum() == 30
