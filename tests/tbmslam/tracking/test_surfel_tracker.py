import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking import surfel_tracker
from tbmslam.tracking.student_t import FREEDOM
from tbmslam.tracking.surfel_tracker import SurfelTracker, SurfelTrackerConfig
from tbmslam.tracking.tracker import Coasting, PosePrior

BEAMS = 720
DEVIATIONS = (0.02, 0.02, 0.015)


def prior_at(mean, coasting=None, deviations=DEVIATIONS):
    """The prior by odometry, and by inertia at a speed that may have changed by half a metre a second within 0.2 s."""
    inertia = Coasting(coasting or mean, (0.105, 0.105, 0.105))
    return PosePrior(mean, deviations, deviations, mean, lambda: inertia, by_odometry=True)


def room_scan(pose, stamp=0.0, shorter=0, half=(4.0, 3.0), noise=0.003):
    """The scan of a room of 8 x 6 m at a pose; some beams end early, where nothing is known."""
    angles = -np.pi + (np.arange(BEAMS) + 0.3) * 2 * np.pi / BEAMS
    cosine, sine = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    to_x = np.where(cosine > 0, (half[0] - pose.x) / cosine, (-half[0] - pose.x) / cosine)
    to_y = np.where(sine > 0, (half[1] - pose.y) / sine, (-half[1] - pose.y) / sine)
    ranges = np.minimum(to_x, to_y)
    ranges[:shorter] *= 0.6
    ranges += np.random.default_rng(round(1e3 * abs(pose.x + pose.y + stamp))).normal(0.0, noise, BEAMS)
    return LaserScan(stamp, angles[0], 2 * np.pi / BEAMS, 0.1, 20.0, ranges)


def corridor_scan(pose, stamp=0.0):
    """The scan of a corridor without ends, 2 m wide."""
    return room_scan(pose, stamp, half=(1e6, 1.0))


def learnt(first):
    """Return a tracker that knows one scan, of a robot at the origin."""
    tracker = SurfelTracker(SurfelTrackerConfig())
    tracker.learn(first, tracker.match(first, prior_at(SE2.identity(), deviations=(0.0, 0.0, 0.0)), SE2.identity()))
    return tracker


@pytest.fixture
def tracker():
    """A tracker that knows the room."""
    return learnt(room_scan(SE2.identity()))


@pytest.fixture
def searched(tracker, monkeypatch):
    """The guesses that it searches around."""
    searched, search = [], tracker._best_near
    monkeypatch.setattr(tracker, "_best_near", lambda hits, guess: searched.append(guess) or search(hits, guess))
    return searched


def only(scan, beams):
    """Return a scan in which just some beams come back."""
    ranges = np.full(BEAMS, np.inf)
    ranges[beams] = scan.ranges[beams]
    return replace(scan, ranges=ranges)


def test_the_first_scan_lies_where_it_lies():
    pose = SE2(1.0, 2.0, 0.5)
    match = SurfelTracker(SurfelTrackerConfig()).match(
        room_scan(pose), prior_at(pose, deviations=(0.0, 0.0, 0.0)), SE2.identity()
    )
    assert match.T_map_sensor == pose
    assert not match.moved


def test_a_scan_moves_what_the_odometry_says_within_its_deviations(tracker):
    pose, mount = SE2(0.3, -0.1, 0.1), SE2(0.2, 0.1, 0.5)
    prior = prior_at(pose @ mount.inverse() @ SE2(0.02, -0.02, 0.01))
    match = tracker.match(room_scan(pose), prior, mount)
    np.testing.assert_allclose(match.T_map_sensor, pose, atol=3e-3)
    assert match.moved
    assert not match.is_lost
    assert match.score > 0.7
    assert match.trust > 0.7


def test_a_slip_is_found_by_a_search(tracker, searched):
    pose = SE2(0.3, -0.2, 0.6)
    match = tracker.match(room_scan(pose), prior_at(SE2(0.1, 0.0, 0.0)), SE2.identity())
    assert len(searched) == 1
    np.testing.assert_allclose(match.T_map_sensor, pose, atol=5e-3)
    assert match.trust < 0.05


def test_what_was_searched_for_in_vain_is_not_searched_for_at_once_again(tracker, searched):
    for number in range(8):
        pose = SE2(0.01 * number, 0.0, 0.0)
        match = tracker.match(room_scan(pose, float(number), shorter=400), prior_at(pose), SE2.identity())
        assert match.score < 0.55
    assert len(searched) == 2  # the first one, and the one after five without


def test_a_scan_that_matches_worse_is_searched_for_all_the_same(tracker, searched):
    for number, shorter in enumerate((400, 400, 560)):
        scan = room_scan(SE2.identity(), float(number), shorter)
        tracker.match(scan, prior_at(SE2.identity()), SE2.identity())
    assert len(searched) == 2


def test_a_scan_without_hits_keeps_the_mean(tracker):
    blind = replace(room_scan(SE2.identity()), ranges=np.full(BEAMS, np.inf))
    match = tracker.match(blind, prior_at(SE2(0.1, 0.0, 0.0)), SE2.identity())
    assert match.T_map_sensor == SE2(0.1, 0.0, 0.0)
    assert not match.moved
    assert not match.is_lost


@pytest.mark.parametrize("heading", [0.0, 0.6])
def test_along_a_bare_corridor_the_odometry_is_kept(heading):
    """And across it and in heading the scan tells."""
    tracker = learnt(corridor_scan(SE2.identity()))
    true, mean = SE2(0.3, 0.1, heading), SE2(0.4, 0.07, heading + 0.02)
    match = tracker.match(corridor_scan(true), prior_at(mean), SE2.identity())
    assert match.T_map_sensor.x == pytest.approx(mean.x, abs=1e-4)
    assert match.T_map_sensor.y == pytest.approx(true.y, abs=2e-3)
    assert match.T_map_sensor.theta == pytest.approx(true.theta, abs=1e-3)


def test_one_hit_does_not_turn_the_robot(tracker):
    mean = SE2(0.1, 0.0, 0.05) @ SE2(0.01, -0.01, 0.0)
    match = tracker.match(only(room_scan(SE2(0.1, 0.0, 0.05)), [90]), prior_at(mean), SE2.identity())
    assert np.abs(np.subtract(match.T_map_sensor, mean)).max() < 4e-3


@pytest.mark.parametrize("beams", [[90, 92, 94], [20, 260, 500]])
@pytest.mark.parametrize("stray", [0.0, 0.5, 1.0])
def test_a_laser_with_three_hits_stays_at_the_odometry(tracker, beams, stray):
    """Hits of people, who stand before the walls, do not move it."""
    mean = SE2(0.1, 0.0, 0.05)
    scan = only(room_scan(mean), beams)
    match = tracker.match(replace(scan, ranges=scan.ranges - stray), prior_at(mean), SE2.identity())
    np.testing.assert_allclose(match.T_map_sensor, mean, atol=0.01)
    assert not match.is_lost


@pytest.mark.parametrize("step", [0.1, 0.2, 0.4])
def test_odometry_that_says_the_opposite_is_overruled_by_a_room(tracker, step):
    true, mean = SE2(step, 0.0, 0.0), SE2(-step, 0.0, 0.0)
    match = tracker.match(room_scan(true), prior_at(mean, coasting=SE2(0.9 * step, 0.0, 0.0)), SE2.identity())
    np.testing.assert_allclose(match.T_map_sensor, true, atol=2e-3)
    assert match.trust < 0.1


@pytest.mark.parametrize("step", [0.3, 0.4])
def test_odometry_that_says_the_opposite_is_overruled_along_a_corridor(step):
    """Its walls are the same everywhere: only the prior by inertia leads the scan to what else it sees."""
    post = (2.5, 0.45)
    tracker = learnt(with_post(corridor_scan(SE2.identity()), SE2.identity(), post))
    true, mean = SE2(step, 0.0, 0.0), SE2(-step, 0.0, 0.0)
    prior = prior_at(mean, coasting=SE2(0.9 * step, 0.0, 0.0))._replace(swerve=1.9 * step)
    match = tracker.match(with_post(corridor_scan(true), true, post), prior, SE2.identity())
    np.testing.assert_allclose(match.T_map_sensor, true, atol=0.01)
    assert match.trust < 0.1


def with_post(scan, pose, post):
    """Return a scan with a post 0.1 m wide at a place of the map."""
    x, y = post[0] - pose.x, post[1] - pose.y
    return among(scan, (math.atan2(y, x),), math.hypot(x, y), width=0.1)


def among(scan, bearings, distance, width=0.4):
    """Return a scan with people of a width in some bearings [rad], at a distance [m]."""
    angles = scan.angle_min + np.arange(BEAMS) * scan.angle_increment
    ranges = scan.ranges.copy()
    for bearing in bearings:
        ranges[np.abs(angles - bearing) < 0.5 * width / distance] = distance
    return replace(scan, ranges=ranges)


@pytest.mark.parametrize("step", [0.15, 0.3])
def test_a_person_who_goes_along_a_corridor_does_not_hold_the_robot_back(step):
    """The person is seen where it was, in the robot's frame, while all walls are the same further on.

    Odometry and inertia agree against it, though the registration begins where it holds the robot back.
    """
    tracker = learnt(among(corridor_scan(SE2.identity()), (0.1,), 1.5))
    true = SE2(step, 0.0, 0.0)
    coasting = SE2(0.9 * step, 0.0, 0.0)
    prior = prior_at(true, coasting, deviations=(0.01, 0.01, 0.005))._replace(start=SE2.identity())
    match = tracker.match(among(corridor_scan(true, 0.2), (0.1,), 1.5), prior, SE2.identity())
    assert match.T_map_sensor.x == pytest.approx(step, abs=0.015)
    np.testing.assert_allclose(match.T_map_sensor[1:], true[1:], atol=2e-3)


@pytest.mark.parametrize("half", [(8.0, 7.0), (1.5, 1.0), (2.0, 9.0)])
def test_a_lost_scan_is_held_by_odometry_and_marked(tracker, half):
    mean, mount = SE2(0.1, 0.0, 0.0), SE2(0.2, 0.0, 0.3)
    match = tracker.match(room_scan(SE2(0.2, 0.1, 0.7), half=half), prior_at(mean), mount)
    assert match.is_lost
    assert not match.moved
    assert match.T_map_sensor == mean @ mount
    assert match.information is None
    assert match.trust == 0.01


def test_some_hits_of_a_scan_fit_by_chance_within_a_loose_prior(tracker):
    """Another place after a gap in the scans: few of the hits lie on known walls."""
    scan = room_scan(SE2.identity(), 1.0)
    other = replace(scan, ranges=np.where(np.arange(BEAMS) % 90 < 40, scan.ranges, 1.7 * scan.ranges))
    tight, loose = (
        tracker.match(other, prior_at(SE2.identity(), deviations=(d, d, d)), SE2.identity()) for d in (0.02, 0.5)
    )
    assert tight.information is not None
    assert loose.information is None
    assert loose.is_lost
    assert loose.T_map_sensor == SE2.identity()


def test_a_scan_that_mostly_fits_elsewhere_overrules_suspected_odometry(tracker):
    """Two fifths of it show a new place."""
    elsewhere, scan = SE2(0.3, -0.2, 0.5), room_scan(SE2(0.3, -0.2, 0.5), 1.0)
    other = replace(scan, ranges=np.where(np.arange(BEAMS) % 60 < 36, scan.ranges, 1.7 * scan.ranges))
    tracker._fault.probability = 0.9
    match = tracker.match(other, prior_at(SE2.identity()), SE2.identity())
    assert not match.is_lost
    np.testing.assert_allclose(match.T_map_sensor, elsewhere, atol=0.02)


@pytest.mark.parametrize("inertia", [Coasting(SE2(0.1, 0.0, 0.0), (0.5, 0.5, 4.0)), None])
@pytest.mark.parametrize("turn", [1.4, -1.4])
def test_one_wrong_reading_of_the_odometry_does_not_shift_what_follows(tracker, turn, inertia):
    """The robot turns between two scans, and the odometry of the first scan contains that turn already."""
    wrong, after = SE2(0.1, 0.0, turn), SE2(0.2, 0.1, turn)
    first = room_scan(SE2(0.1, 0.0, 0.0), 1.0)
    match = tracker.match(first, prior_at(wrong, coasting=SE2(0.1, 0.0, 0.0)), SE2.identity())
    assert match.T_map_sensor.theta == pytest.approx(0.0, abs=0.01)
    tracker.learn(first, match)
    by_odometry = match.T_map_sensor @ wrong.to(after)  # which began again at the first scan
    prior = prior_at(by_odometry)._replace(coasting=lambda: inertia)
    found = tracker.match(room_scan(after, 2.0), prior, SE2.identity())
    np.testing.assert_allclose(found.T_map_sensor, after, atol=0.01)


def test_odometry_that_began_anew_does_not_return(tracker):
    tracker._fault.probability = 0.9
    tracker._fault.remember(SE2(0.0, 0.0, 0.5), SE2.identity(), DEVIATIONS)
    by_inertia = prior_at(SE2.identity())._replace(by_odometry=False)
    tracker.match(room_scan(SE2.identity(), 1.0), by_inertia, SE2.identity())
    assert tracker._fault.returned(SE2.identity(), DEVIATIONS) is None


def test_surprising_priors_are_rare():
    """Of a prior with Student's t distribution the squared distance follows Fisher's F distribution."""
    assert stats.f.sf(surfel_tracker._SURPRISING / 3.0, 3, FREEDOM) == pytest.approx(0.005, rel=0.01)
