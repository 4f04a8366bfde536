from dataclasses import replace

import numpy as np
import pytest

from tbmslam.laser_scan import LaserScan
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2
from tbmslam.tracking.surfel_tracker import SurfelTracker, SurfelTrackerConfig

BEAMS = 360
SLACK = np.array([0.05, 0.05, 0.02])


def room_scan(pose, stamp=0.0, shorter=0):
    """The scan of a room of 8 x 6 m at a pose; some beams end early, where nothing is known."""
    angles = -np.pi + (np.arange(BEAMS) + 0.3) * 2 * np.pi / BEAMS
    cosine, sine = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    to_x = np.where(cosine > 0, (4.0 - pose.x) / cosine, (-4.0 - pose.x) / cosine)
    to_y = np.where(sine > 0, (3.0 - pose.y) / sine, (-3.0 - pose.y) / sine)
    ranges = np.minimum(to_x, to_y)
    ranges[:shorter] *= 0.6
    return LaserScan(stamp, angles[0], 2 * np.pi / BEAMS, 0.1, 30.0, ranges)


@pytest.fixture
def tracker(monkeypatch):
    """A tracker that knows the room, and a list of the guesses it searched around."""
    tracker, searched = SurfelTracker(SurfelTrackerConfig()), []
    first = room_scan(SE2.identity())
    tracker.learn(first, tracker.match(first, SE2.identity(), np.zeros(3), SE2.identity))
    search = tracker._search
    monkeypatch.setattr(tracker, "_search", lambda hits, guess: searched.append(guess) or search(hits, guess))
    return tracker, searched


def test_the_first_scan_lies_where_it_lies():
    pose = SE2(1.0, 2.0, 0.5)
    match = SurfelTracker(SurfelTrackerConfig()).match(room_scan(pose), pose, np.zeros(3), SE2.identity)
    assert match.T_map_sensor == pose
    assert not match.moved


def test_a_slip_is_found_by_a_search(tracker):
    tracker, searched = tracker
    pose = SE2(0.3, -0.2, 0.6)
    match = tracker.match(room_scan(pose), SE2(0.1, 0.0, 0.0), SLACK, lambda: SE2(0.1, 0.0, 0.0))
    assert len(searched) == 1
    np.testing.assert_allclose(match.T_map_sensor, pose, atol=0.02)


def test_what_was_searched_for_in_vain_is_not_searched_for_at_once_again(tracker):
    tracker, searched = tracker
    for number in range(8):
        new = room_scan(SE2(0.01 * number, 0.0, 0.0), float(number), shorter=200)
        match = tracker.match(new, SE2(0.01 * number, 0.0, 0.0), SLACK, lambda: SE2(0.0, 0.0, 0.0))
        assert match.score < 0.55
    assert len(searched) == 2  # the first one, and the one after five without


def test_a_scan_that_matches_worse_is_searched_for_all_the_same(tracker):
    tracker, searched = tracker
    for number, shorter in enumerate((200, 200, 280)):
        tracker.match(room_scan(SE2.identity(), float(number), shorter), SE2.identity(), SLACK, SE2.identity)
    assert len(searched) == 2


def test_odometry_that_stood_still_or_turned_otherwise_is_doubted_for_a_while(tracker):
    tracker, _ = tracker
    found, deviations = SE2(0.25, 0.0, 0.1), np.array([0.03, 0.03, 0.02])

    def holds_back(*there):
        return tracker._may_hold_back(found, SE2(*there), deviations)

    further, still, turned = (0.5, 0.0, 0.1), (0.0, 0.0, 0.1), (0.5, 0.0, 0.0)
    assert holds_back(*further)
    assert not holds_back(0.2, 0.0, 0.1)
    assert holds_back(*further)
    for wrong in (still, turned):
        assert not holds_back(*wrong)
        doubted = [not holds_back(*further) for _ in range(12)]
        assert doubted == [True] * 9 + [False] * 3
    scan = room_scan(found)
    tracker.settled(scan, ScanMatch(found, 0.0, moved=False), None)
    assert not holds_back(*further)


def test_a_scan_without_hits_keeps_the_guess(tracker):
    tracker, _ = tracker
    blind = replace(room_scan(SE2.identity()), ranges=np.full(BEAMS, np.inf))
    match = tracker.match(blind, SE2(0.1, 0.0, 0.0), SLACK, SE2.identity)
    assert match.T_map_sensor == SE2(0.1, 0.0, 0.0)
    assert not match.moved
