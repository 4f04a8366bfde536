import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.faults import Fault, inject
from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.blocked_beams import BlockedBeams, BlockedBeamsConfig, BlockedSpans, LaserView, directions
from tbmslam.monitoring.incidents import Incidents
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.slam import Slam


def scan(stamp, ranges):
    return LaserScan(stamp, -1.0, 0.02, 0.02, 30.0, np.asarray(ranges, dtype=np.float64))


def test_beams_are_cleared_for_the_readings_in_which_they_were_blocked():
    spans, beams = BlockedSpans(), np.array([True, True, False, False])
    since, none = np.array([2.0, 4.0, 0.0, 0.0]), np.zeros(4, dtype=np.bool_)
    assert not spans.were_any()
    spans.end(beams, since, 9.0)
    assert spans.were_any()
    for index, hidden in ((1, []), (2, [0]), (5, [0, 1]), (9, [])):
        cleared = spans.cleared(scan(0.0, [0.4] * 4), index, none, since)
        assert np.flatnonzero(np.isnan(cleared.ranges)).tolist() == hidden


def test_beams_still_blocked_are_cleared_since_they_are():
    beams, since = np.array([False, True]), np.array([0.0, 4.0])
    for index, hidden in ((3, 0), (4, 1), (10**9, 1)):
        assert np.isnan(BlockedSpans().cleared(scan(0.0, [1.0, 1.0]), index, beams, since).ranges).sum() == hidden


def test_scans_of_fewer_beams_stay_as_they_are():
    spans = BlockedSpans()
    spans.end(np.array([False, False, True]), np.zeros(3), 9.0)
    short = scan(5.0, [1.0, 1.0])
    assert spans.cleared(short, 5, np.zeros(2, dtype=np.bool_), np.zeros(2)) is short


def test_spans_of_the_same_beams_that_abut_or_overlap_are_one():
    spans, none = BlockedSpans(), np.zeros(4, dtype=np.bool_)
    cable, post = np.array([True, True, False, False]), np.array([False, False, False, True])
    for k in range(1000):
        spans.end(cable, np.full(4, float(k)), k + 1.0)
        spans.end(post, np.full(4, 2.0 * k - 1.0), 2.0 * k + 1.0)
    assert len(pickle.dumps(spans)) < 2000
    spans.end(cable, np.full(4, 1001.0), 1002.0)  # a scan in between is not cleared
    for index, hidden in ((-1, [3]), (0, [0, 1, 3]), (999, [0, 1, 3]), (1000, [3]), (1001, [0, 1, 3])):
        cleared = spans.cleared(scan(0.0, [0.5] * 4), index, none, np.zeros(4))
        assert np.flatnonzero(np.isnan(cleared.ranges)).tolist() == hidden


def test_any_moment_is_cleared_as_by_going_over_all_spans(generator):
    spans, ended, none = BlockedSpans(), [], np.zeros(6, dtype=np.bool_)
    for stamp in range(1, 60):
        marked = generator.uniform(size=6) < 0.4
        since = stamp - generator.choice([1.0, 1.0, 2.0, 3.0, 40.0], 6)
        spans.end(marked, since, float(stamp))
        ended += [(b, since[b], float(stamp)) for b in np.flatnonzero(marked)]
        for moment in range(-45, stamp + 2) if stamp % 20 == 0 else ():
            ranges = generator.choice([0.2, 0.5, 5.0, np.nan], 6)
            hidden = np.isnan(ranges)
            for beam, begin, until in ended:
                hidden[beam] |= begin <= moment < until
            cleared = spans.cleared(scan(0.0, ranges), moment, none, since)
            np.testing.assert_array_equal(np.isnan(cleared.ranges), hidden)


@pytest.mark.parametrize(
    ("beams", "said"),
    [
        (slice(0, 10), "-57 to -47°"),
        ([*range(10), *range(12, 15)], "-57 to -41°"),
        ([0, 20, 40, 60, 80], "-57 to -57, -34 to -34, -11 to -11° and 2 more"),
    ],
)
def test_directions_for_people(beams, said):
    marked = np.zeros(100, dtype=np.bool_)
    marked[beams] = True
    assert directions(scan(0.0, np.zeros(100)), marked) == said


rng = np.random.default_rng(0)


def blocked_beams_scan(k, ranges):
    return LaserScan(float(k), -1.0, 0.02, 0.02, 30.0, np.asarray(ranges))


def drive(ranges_of, steps=40, turning=True):
    """Drive 0.3 m a step through surroundings, on a winding way."""
    beams, found = BlockedBeams(BlockedBeamsConfig()), []
    for k in range(steps):
        pose = SE2(0.3 * k, 0.0, 0.8 * np.sin(0.5 * k) if turning else 0.0)
        if beams.learn(blocked_beams_scan(k, ranges_of(k)), k, pose):
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
    cleaned = beams.without(blocked_beams_scan(50, covered(50)))
    assert np.isnan(cleaned.ranges[20:50]).all()
    assert np.isfinite(np.delete(cleaned.ranges, np.s_[20:50])).all()


def test_earlier_scans_are_cleared_afterwards_but_not_those_before_the_cover():
    beams, _ = drive(lambda k: covered(k, until=30))
    assert not beams.blocked.any()
    for k, hidden in ((4, 0), (5, 30), (20, 30), (30, 0), (35, 0)):
        assert np.isnan(beams.cleared(blocked_beams_scan(k, open_space(k)), k).ranges).sum() == hidden


def test_a_beam_that_sees_far_again_is_unblocked_at_once():
    beams, _ = drive(covered)
    assert np.isfinite(beams.without(blocked_beams_scan(50, open_space(50))).ranges).all()


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
    same = blocked_beams_scan(50, ranges_of(50))
    assert beams.without(same) is same
    assert beams.cleared(same, 50) is same


def test_what_is_very_near_and_does_not_change_is_not_believed_for_now():
    beams, found = drive(lambda _: np.where(np.arange(100) < 30, 0.25, 5.0), steps=3, turning=False)
    assert found == []
    assert np.isnan(beams.without(blocked_beams_scan(3, np.full(100, 0.25))).ranges).sum() == 30
    assert np.isfinite(beams.without(blocked_beams_scan(3, np.full(100, 0.4))).ranges).all()


@pytest.mark.parametrize("reach", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("world", ["office", "apartment"])
def test_a_laser_that_sees_near_things_alone_has_nothing_in_view(drive_in, world, reach):
    """Between two walls that happen to be as far it sees nothing, which is no proof that it saw the same thing."""
    beams = BlockedBeams(BlockedBeamsConfig())
    for k, reading in enumerate(drive_in(world, 60.0, "good", seed=2, beams=361).readings):
        ranges = np.where(reading.scan.ranges > reach, np.inf, reading.scan.ranges)
        assert not beams.learn(reading.scan.with_ranges(ranges), k, reading.T_odom_robot)
    assert not beams.were_any()


@pytest.mark.parametrize("lost", [0.0, 0.5, 0.8])
def test_a_cover_that_seldom_returns_takes_longer_to_be_found(lost):
    def seldom(k):
        return np.where(rng.random(100) < lost * (np.abs(np.arange(100) - 35) <= 15), np.inf, covered(k))

    _, found = drive(seldom, steps=60)
    assert 6 <= found[0] <= 8.0 / (1.0 - lost) + 5.0


def test_a_robot_at_rest_reports_no_blocked_beams():
    beams = BlockedBeams(BlockedBeamsConfig())
    assert not any(beams.learn(blocked_beams_scan(k, covered(9)), k, SE2.identity()) for k in range(50))


@pytest.mark.parametrize("starts", [True, False])
def test_a_robot_at_rest_whose_odometry_starts_or_stops_reports_no_blocked_beams(starts):
    beams, far = BlockedBeams(BlockedBeamsConfig()), SE2(100.0, 0.0, 2.0)
    odometry = [None, far] if starts else [far, None]
    assert not any(
        beams.learn(blocked_beams_scan(k, covered(9)), k, SE2.identity(), odometry[k // 25]) for k in range(50)
    )


@pytest.mark.parametrize("is_forgotten", [True, False])
def test_odometry_that_jumps_blocks_no_beams_if_it_is_forgotten(is_forgotten):
    beams, odometry = BlockedBeams(BlockedBeamsConfig()), [SE2.identity(), SE2(5.0, 2.0, 2.0), SE2(0.0, 9.0, -2.0)]
    found = []
    for k in range(60):
        if is_forgotten and k % 20 == 0:
            beams.forget_odometry()
        found.append(beams.learn(blocked_beams_scan(k, covered(9)), k, SE2.identity(), odometry[k // 20]))
    assert any(found) != is_forgotten


def test_another_number_of_beams_restarts_the_check():
    beams, _ = drive(covered)
    other = blocked_beams_scan(50, np.full(60, 0.25))
    assert not beams.learn(other, 50, SE2(99.0, 0.0, 0.0))
    assert beams.without(other) is other
    assert np.isnan(beams.cleared(blocked_beams_scan(20, covered(20)), 20).ranges).sum() == 30


ANGLES = -1.0 + 0.02 * np.arange(100)
COVERED = slice(0, 20)


def laser_view_drive(turning, until=40, config=None):
    """Drive through a hall with 20 beams covered."""
    incidents = Incidents()
    view = LaserView(config or BlockedBeamsConfig(), incidents)
    rng = np.random.default_rng(2)
    for k in range(60):
        pose = SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k) * turning)
        ranges = 8.0 + rng.normal(0.0, 0.005, 100)
        if k < until:
            ranges[COVERED] = 0.6 + rng.normal(0.0, 0.005, 20)
        scan = LaserScan(float(k), -1.0, 0.02, 0.02, 30.0, ranges)
        cleaned = view.cleaned(scan)
        view.learn(k, pose)
    return view, [incident.text(0.0) for incident in incidents], cleaned


def test_blocked_beams_are_reported_once_with_the_time():
    view, told, cleaned = laser_view_drive(1.0)
    assert told == [
        "at 0.0 s: a part of the robot, or something that moves with it, blocks 20% of the beams, -57 to -36°"
    ]
    assert view.were_any_blocked()
    assert np.isfinite(cleaned.ranges).all()
    early = view.cleared(LaserScan(3.0, -1.0, 0.02, 0.02, 30.0, np.full(100, 0.6)), 3)
    assert np.isnan(early.ranges[COVERED]).all()


def test_only_turning_tells():
    assert laser_view_drive(0.0)[1] == []


@pytest.mark.parametrize("step", [math.radians(0.25), -math.radians(0.25), 1e-9, 1e-320])
def test_a_fan_narrower_than_what_counts_as_beside(step):
    incidents, rng = Incidents(), np.random.default_rng(2)
    view = LaserView(BlockedBeamsConfig(), incidents)
    for k in range(40):
        ranges = 8.0 + rng.normal(0.0, 0.005, 30)
        ranges[:10] = 0.25
        scan = LaserScan(float(k), 0.0, step, 0.02, 30.0, ranges)
        cleaned = view.cleaned(scan)
        view.learn(k, SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k)))
    assert np.flatnonzero(np.isnan(cleaned.ranges)).tolist() == list(range(10))
    assert len(incidents) == 1


def test_a_single_beam_without_a_step():
    incidents, config = Incidents(), BlockedBeamsConfig(fewest=1)
    view = LaserView(config, incidents)
    for k in range(40):
        pose = SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k))
        cleaned = view.cleaned(LaserScan(float(k), 0.0, 0.0, 0.02, 30.0, np.full(1, 0.25)))
        view.learn(k, pose)
    assert np.isnan(cleaned.ranges).all()
    assert len(incidents) == 1


def message_of(blocked_at, stamps):
    """Return what is told, where beams are blocked at some times."""
    incidents, rng = Incidents(), np.random.default_rng(2)
    view = LaserView(BlockedBeamsConfig(), incidents)
    for k, stamp in enumerate(stamps):
        ranges = 8.0 + rng.normal(0.0, 0.005, 100)
        for beams, near in blocked_at(k):
            ranges[beams] = near
        pose = SE2(0.31 * k, 0.0, 0.8 * math.sin(0.5 * k))
        view.cleaned(LaserScan(float(stamp), -1.0, 0.02, 0.02, 30.0, ranges))
        view.learn(k, pose)
    return [incident.text(0.0) for incident in incidents]


def test_a_shaking_post_is_reported_once():
    shaking = message_of(lambda k: [(COVERED, 0.7 if k % 100 == 99 else 0.6)], range(2000))
    assert shaking == [
        "at 0.0 s: a part of the robot, or something that moves with it, blocks 20% of the beams, -57 to -36°"
    ]


def test_beams_that_are_blocked_again_later_are_reported_again():
    told = message_of(lambda k: [] if 100 <= k < 300 else [(COVERED, 0.6)], range(400))
    assert [text.split(":")[0] for text in told] == ["at 0.0 s", "at 300.0 s"]


def test_blocked_beams_are_not_reported_again_after_a_gap():
    other = slice(60, 80)
    stamps = [k if k < 100 else k + 500 for k in range(200)]
    told = message_of(lambda k: [(COVERED, 0.6)] + ([(other, 0.5)] if k >= 100 else []), stamps)
    assert [text.rsplit(", ", 1)[1] for text in told] == ["-57 to -36°", "11 to 33°"]
    assert told[1].startswith("at 600.0 s")


@pytest.mark.slow
@pytest.mark.parametrize(("world", "seed"), [("apartment", 1), ("halls", 3)])
def test_a_covered_laser_without_odometry_is_placed_wrongly_if_its_beams_count(drive_in, world, seed):
    """Ablation of `tbmslam.monitoring.blocked_beams`: 1.2 and 0.6 m instead of 0.2 and 0.04 m."""
    covered = inject(
        drive_in(world, 100.0, seed=seed), Fault("beams_blocked", 10.0, 1e9), make_world(world, seed), seed
    )

    def ate_m(is_enabled):
        slam = Slam(changed(SlamConfig(), {"blocked_beams": {"enabled": is_enabled}}))
        for reading in covered.readings:
            slam.process(replace(reading, T_odom_robot=None, T_odom_swept=None))
        return align_trajectories(covered.truth, slam.finish().drives[0].trajectory).ate_m

    assert ate_m(is_enabled=True) < 0.4 * ate_m(is_enabled=False)
