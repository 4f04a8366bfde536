import math

import numpy as np
import pytest

from datasets.odometry.se3 import SE3
from datasets.options import RecordingOptions
from datasets.rosbag.survey import Survey
from datasets.scans.intake import RawScan

EMPTY, SOME = np.full(3, np.inf), np.ones(3)


def surveyed(*scans, **options):
    """Return a survey of scans, each given as frame and ranges."""
    survey = Survey(RecordingOptions(**options))
    for number, (frame, ranges) in enumerate(scans):
        survey.add_scan(frame, RawScan(0.1 * number, -1.0, 0.1, 0.1, 30.0, ranges), 0.1 * number)
    return survey


def at(stamps):
    survey = Survey(RecordingOptions())
    for stamp in stamps:
        survey.add_scan("laser", RawScan(stamp, -1.0, 0.1, 0.1, 30.0, SOME), stamp)
    return survey


def test_a_scan_takes_no_longer_than_the_next_is_away():
    assert at([0.0, 0.1, 0.2, 0.1, 0.2, 9.0, 9.1]).laser.longest_sweep() == pytest.approx(0.11)
    assert at([1.0]).laser.longest_sweep() == math.inf


@pytest.mark.parametrize(
    "stamps",
    [[10.2 * burst + 0.1 * scan for burst in range(20) for scan in range(3)], [0.0, 0.1, 0.2, 30.0]],
    ids=["frequent", "few scans"],
)
def test_pauses_do_not_make_a_scan_longer(stamps):
    assert at(stamps).laser.longest_sweep() == pytest.approx(0.11)


def test_stamps_that_come_in_pairs_leave_the_period_known():
    """A Neato turns five times a second; its scans are stamped when they arrive, mostly after 0.15 s, then 0.3 s."""
    steps = [0.15, 0.15, 0.3] * 12
    assert at(np.cumsum([0.0, *steps])).laser.longest_sweep() == pytest.approx(0.22)
    assert at(np.cumsum([0.0, *steps, 160.0, *steps])).laser.longest_sweep() == pytest.approx(0.22)


def test_scans_that_arrive_two_at_a_time_leave_the_period_known():
    steps = [0.001, 0.399] * 20 + [0.001]
    assert at(np.cumsum([0.0, *steps])).laser.longest_sweep() == pytest.approx(0.22, rel=0.03)


def test_an_unset_stamp_gives_no_lag():
    survey = at([math.nan, 1.0])
    survey.add_pose("odom", "base_link", SE3.identity(), math.nan)
    survey.add_pose("odom", "base_link", SE3.identity(), 0.5)
    assert survey.laser.lags == [0.0]
    assert survey.odometry_lags == [0.5]


def test_the_laser_with_most_usable_scans_wins():
    survey = surveyed(("blind", EMPTY), ("/front", SOME), ("blind", EMPTY), ("front", SOME), ("blind", EMPTY))
    assert survey.laser.frame == "front"
    assert [(laser.frame, laser.usable, laser.scans) for laser in survey.lasers.values()] == [
        ("blind", 0, 3),
        ("front", 2, 2),
    ]


@pytest.mark.parametrize("useless", [[0.05] * 3, [30.0] * 3, [np.nan] * 3, [81.9] * 3, [0.0, -1.0, np.inf], []])
def test_usable_is_what_holds_a_hit_within_the_limits(useless):
    assert surveyed(("blind", np.array(useless)), ("front", SOME)).laser.frame == "front"


def test_the_limits_that_are_asked_for_count():
    scans = [("near", SOME), ("far", np.full(3, 20.0))]
    assert surveyed(*scans).laser.frame == "near"
    assert surveyed(*scans, range_min=2.0).laser.frame == "far"
    assert surveyed(*scans, no_return_codes=(1.0,)).laser.frame == "far"


def test_of_lasers_with_as_many_usable_scans_the_first_wins():
    assert surveyed(("b", SOME), ("a", SOME), ("b", EMPTY)).laser.frame == "b"
    assert surveyed(("b", EMPTY), ("a", EMPTY), ("a", EMPTY)).laser.frame == "b"


def test_what_is_known_of_other_lasers_does_not_count():
    survey = surveyed(("blind", EMPTY), ("blind", EMPTY), ("front", SOME))
    assert len(survey.laser.ranges) == 1
    assert survey.laser.first_scan.ranges is SOME


def test_the_laser_that_is_asked_for_is_taken():
    scans = [("blind", EMPTY), ("front", SOME)]
    assert surveyed(*scans, laser_frame="/blind").laser.frame == "blind"
    assert surveyed(*scans, laser_frame="rear").laser is None


def rooms(number, lasers, seed=0):
    """Scans of lasers that take turns, each of which slowly drives through another room."""
    random = np.random.default_rng(seed)
    places = [random.uniform(1.0, 9.0, beams) for beams in lasers]
    for k in range(number):
        which = k % len(places)
        yield "laser", places[which] * (1.0 + 0.01 * k / number) + random.normal(0.0, 0.01, len(places[which]))


@pytest.mark.parametrize(
    ("lasers", "alternate"), [([180], False), ([180, 180], True), ([180, 361], True), ([180, 180, 180], False)]
)
def test_scans_of_two_lasers_in_turn_are_noticed(lasers, alternate):
    assert surveyed(*rooms(60, lasers)).laser.alternates() is alternate
    assert not surveyed(*rooms(10, lasers)).laser.alternates()


def test_a_scan_without_hits_is_unlike_none():
    blind = ("laser", np.full(180, np.inf))
    scans = [scan for one in rooms(60, [180]) for scan in (one, blind)]
    assert not surveyed(*scans).laser.alternates()
    assert not surveyed(*[blind] * 60).laser.alternates()


def test_the_wait_for_stamps_has_an_end():
    """Some drivers never set a stamp, and the whole recording would be read for the survey."""
    survey = Survey(RecordingOptions())
    for second in range(300):
        survey.add_scan("laser", RawScan(math.nan, -1.0, 0.1, 0.1, 30.0, SOME), float(second))
        assert not survey.is_enough(float(second))
        assert not survey.waited_in_vain
    assert survey.is_enough(301.0)
    assert survey.waited_in_vain


def test_few_lags_of_the_odometry_are_kept():
    survey = Survey(RecordingOptions())
    for _ in range(2000):
        survey.add_pose("odom", "base_link", SE3.identity(), 0.5)
    assert survey.odometry_lags == [0.5] * 500
