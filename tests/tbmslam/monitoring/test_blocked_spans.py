"""Beams that were blocked for a while, cleared afterwards and told."""

import numpy as np
import pytest

from tbmslam.monitoring.blocked_spans import BlockedSpans, directions
from tbmslam.sensing.laser_scan import LaserScan


def scan(stamp, ranges):
    return LaserScan(stamp, -1.0, 0.02, 0.02, 30.0, np.asarray(ranges, dtype=np.float64))


def test_beams_are_cleared_for_the_time_in_which_they_ended_so_near():
    spans, beams = BlockedSpans(), np.array([True, True, False, False])
    since, farthest = np.array([2.0, 4.0, 0.0, 0.0]), np.array([0.5, np.inf, 0.0, 0.0])
    none = np.zeros(4, dtype=np.bool_)
    assert not spans.were_any()
    spans.end(beams, since, farthest, 9.0)
    assert spans.were_any()
    for stamp, hidden in ((1.0, []), (2.0, [0]), (5.0, [0, 1]), (9.0, [])):
        cleared = spans.cleared(scan(stamp, [0.4] * 4), none, since, farthest)
        assert np.flatnonzero(np.isnan(cleared.ranges)).tolist() == hidden
    far = spans.cleared(scan(5.0, [3.0] * 4), none, since, farthest)
    assert np.flatnonzero(np.isnan(far.ranges)).tolist() == [1]


def test_beams_still_blocked_are_cleared_since_they_are():
    beams, since = np.array([False, True]), np.array([0.0, 4.0])
    for stamp, hidden in ((3.0, 0), (4.0, 1), (1e9, 1)):
        cleared = BlockedSpans().cleared(scan(stamp, [1.0, 1.0]), beams, since, np.full(2, 2.0))
        assert np.isnan(cleared.ranges).sum() == hidden


def test_scans_of_fewer_beams_and_of_other_times_stay_as_they_are():
    spans = BlockedSpans()
    spans.end(np.array([False, False, True]), np.zeros(3), np.full(3, np.inf), 9.0)
    short = scan(5.0, [1.0, 1.0])
    assert spans.cleared(short, np.zeros(2, dtype=np.bool_), np.zeros(2), np.zeros(2)) is short


def test_spans_of_the_same_beams_that_abut_or_overlap_are_one():
    spans, near = BlockedSpans(), np.full(4, 0.5)
    cable, post = np.array([True, True, False, False]), np.array([False, False, False, True])
    for k in range(1000):
        spans.end(cable, np.full(4, float(k)), near, k + 1.0)
        spans.end(post, np.full(4, 2.0 * k - 1.0), near, 2.0 * k + 1.0)
    assert len(spans) == 2
    spans.end(cable, np.full(4, 1000.5), near, 1002.0)  # a scan in between is not cleared
    spans.end(cable, np.full(4, 1002.0), near + 0.1, 1003.0)  # nor what is as far
    assert len(spans) == 4
    none = np.zeros(4, dtype=np.bool_)
    for stamp, hidden in ((-0.5, [3]), (0.0, [0, 1, 3]), (999.5, [0, 1, 3]), (1000.2, [3]), (1001.0, [0, 1, 3])):
        cleared = spans.cleared(scan(stamp, [0.5] * 4), none, near, near)
        assert np.flatnonzero(np.isnan(cleared.ranges)).tolist() == hidden


def test_any_moment_is_cleared_as_by_going_over_all_spans(generator):
    spans, ended, beams = BlockedSpans(), [], 6
    none = np.zeros(beams, dtype=np.bool_)
    for stamp in range(1, 60):
        marked = generator.uniform(size=beams) < 0.4
        since = stamp - generator.choice([1.0, 1.0, 2.0, 3.0, 40.0], beams)
        farthest = generator.choice([0.3, 0.6, np.inf], beams)
        spans.end(marked, since, farthest, float(stamp))
        ended += [(b, since[b], float(stamp), farthest[b]) for b in np.flatnonzero(marked)]
        if stamp % 20:
            continue
        for moment in np.arange(-45.0, stamp + 2.0, 0.5):
            ranges = generator.choice([0.2, 0.5, 5.0, np.nan], beams)
            hidden = np.isnan(ranges)
            for beam, begin, until, far in ended:
                hidden[beam] |= begin <= moment < until and ranges[beam] <= far
            cleared = spans.cleared(scan(moment, ranges), none, since, farthest)
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
