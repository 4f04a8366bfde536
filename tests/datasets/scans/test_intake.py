import math

import numpy as np
import pytest

from datasets.counts import ReadingCounts
from datasets.scans.cleaning import RangeRules
from datasets.scans.intake import RawScan, ScanIntake, angle_warning, are_degrees
from tests.warnings_page import is_explained


def raw(stamp, ranges=(1.0, 2.0), step=0.1, **others):
    return RawScan(stamp, -0.5, step, 0.1, 30.0, np.array(ranges, dtype=np.float32), **others)


def take(*scans, angle_step=None):
    counts = ReadingCounts()
    intake = ScanIntake(RangeRules(None, None, (), "free"), angle_step, 2.0, counts)
    return [intake.take(scan) for scan in scans], counts


def test_an_offset_moves_hits_and_limits():
    intake = ScanIntake(RangeRules(None, None, (), "free", 0.1), None, 2.0, ReadingCounts())
    scan = intake.take(RawScan(0.0, 0.0, 0.1, 0.2, 30.0, np.array([1.0, 30.0, 0.1])))
    np.testing.assert_allclose(scan.ranges, [1.1, np.inf, np.nan])
    assert (scan.range_min, scan.range_max) == (pytest.approx(0.3), pytest.approx(30.1))


def test_an_offset_may_leave_nothing_of_a_scan():
    counts = ReadingCounts()
    intake = ScanIntake(RangeRules(None, None, (), "free", -9.0), None, 2.0, counts)
    assert intake.take(RawScan(0.0, 0.0, 0.1, 0.2, 8.0, np.array([1.0, 7.0]))) is None
    assert counts.dropped == {"empty": 1}
    assert intake.take(RawScan(1.0, 0.0, 0.1, 0.2, 8.0, np.array([1.0, 8.0]))).range_max == 0.0


def test_a_duplicate_may_come_a_little_later():
    scans, counts = take(raw(1.0), raw(1.1), raw(1.0))
    assert [scan is not None for scan in scans] == [True, True, False]
    assert counts.dropped == {"duplicate": 1}
    assert counts.backward_stamps == 0


def test_a_clock_that_is_set_right_again_makes_no_gap():
    _, counts = take(*(raw(stamp) for stamp in (100.0, 70.0, 100.1, 95.0, 96.0, 101.0)))
    assert (counts.backward_stamps, counts.gaps) == (2, 0)
    _, counts = take(*(raw(stamp) for stamp in (100.0, 70.0, 90.0, 110.0)))
    assert counts.pauses == [(70.0, 20.0), (100.0, 10.0)]


def test_an_equal_later_scan_is_no_duplicate():
    scans, counts = take(raw(1.0), raw(2.0))
    assert None not in scans
    assert counts.dropped == {}


@pytest.mark.parametrize("step", [0.0, np.nan, np.inf])
def test_a_senseless_step_makes_a_scan_useless(step):
    scans, counts = take(raw(1.0, step=step))
    assert scans == [None]
    assert counts.dropped == {"unreadable": 1}
    assert take(raw(1.0, step=step), angle_step=0.2)[0][0].angle_increment == 0.2


def test_angles_in_degrees_are_read_as_such():
    told = RawScan(1.0, -90.0, 0.5, 0.1, 30.0, np.full(361, 2.0, dtype=np.float32))
    (scan,), counts = take(told)
    assert (scan.angle_min, scan.angle_increment) == pytest.approx((-math.pi / 2, math.radians(0.5)))
    assert counts.dropped == {}


@pytest.mark.parametrize("step", [1e-30, -1e-9, 1e30])
def test_a_fan_that_no_laser_has_is_left_out(step):
    scans, counts = take(raw(1.0, step=step))
    assert scans == [None]
    assert counts.dropped == {"impossible_angles": 1}


@pytest.mark.parametrize(("stated", "believed"), [(0.05, True), (0.2, False), (0, True), (-1, True), (np.nan, True)])
def test_the_time_between_beams_must_be_possible(stated, believed):
    counts = ReadingCounts()
    intake = ScanIntake(RangeRules(None, None, (), "free"), None, 2.0, counts, longest_sweep=0.1)
    scan = intake.take(raw(1.0, time_increment=stated))
    assert scan.time_increment == (0.05 if stated == 0.05 else 0.0)
    assert counts.doubtful_sweeps == (not believed)
    assert ("1 scan states an impossible time between beams" in counts.summary()) == (not believed)


def test_nothing_in_range_is_information():
    (scan,), counts = take(raw(1.0, [np.inf, np.inf]))
    assert np.isinf(scan.ranges).all()
    assert counts.dropped == {}


@pytest.mark.parametrize(
    ("ranges", "any_finite"), [([np.inf, np.nan], False), ([np.inf, 500.0], True), ([0.0, 0.0], True), ([], False)]
)
def test_it_is_known_whether_any_range_is_finite(ranges, any_finite):
    _, counts = take(raw(1.0, ranges), raw(1.1, [np.inf, np.inf]))
    assert counts.any_finite is any_finite
    assert "any_finite" not in counts.as_dict()


def test_memory_of_stamps_is_bounded():
    counts = ReadingCounts()
    intake = ScanIntake(RangeRules(None, None, (), "free"), None, 2.0, counts)
    for k in range(1000):
        intake.take(raw(0.1 * k))
    assert len(intake._seen) <= 64


def surroundings(number, code, seed=0):
    """Return scans of walls 2 to 5 m away, in the later half of which four beams end at what may be a code."""
    random = np.random.default_rng(seed)
    scans = [random.uniform(2.0, 5.0, 40) for _ in range(number)]
    for scan in scans[number // 2 :]:
        scan[10:14] = code() if callable(code) else code
    return [raw(0.1 * k, ranges=scan) for k, scan in enumerate(scans)]


def test_a_late_code_is_detected():
    _, counts = take(*surroundings(40, 8.0))
    assert counts.likely_code() == 8.0
    assert (counts.farthest_beams, counts.farthest_scans) == (80, 20)


def test_what_is_no_code_is_not_taken_for_one():
    random = np.random.default_rng(1)
    far = [take(*surroundings(40, lambda: random.normal(8.0, 0.01, 4)))[1]]  # a wall
    far += [take(*surroundings(40, 2.0))[1]]  # not the longest
    far += [take(*surroundings(6, 8.0))[1]]  # too few
    far += [take(*surroundings(40, np.inf))[1]]  # known as what it is
    assert [counts.likely_code() for counts in far] == [None] * 4


def test_the_farthest_hit_may_be_near():
    _, counts = take(raw(1.0, [0.4, np.nan, 0.6]), raw(2.0, [np.inf, np.nan, np.inf]))
    assert counts.farthest_m == pytest.approx(0.6)


def test_scans_that_were_cleaned_together_are_taken_as_each_alone():
    rules = RangeRules(0.2, None, (8.0,), "free", 0.1)
    scans = [
        raw(1.0, [1.0, 2.0, 8.0]),
        raw(2.0, [np.nan, 0.0, 0.1]),
        raw(3.0, []),
        raw(4.0, [3.0, 29.5]),
        raw(5.0, [1.0, -np.inf, np.inf])._replace(range_max=5.0),
        raw(5.0, [1.0, -np.inf, np.inf])._replace(range_max=5.0),
        raw(6.0, [7.0, 7.0, 7.0]),
    ]
    together, alone = ReadingCounts(), ReadingCounts()
    intake = ScanIntake(rules, None, 2.0, together)
    taken = [intake.take(scan, clean) for scan, clean in zip(scans, intake.cleaned(scans), strict=True)]
    intake = ScanIntake(rules, None, 2.0, alone)
    for scan, expected in zip(taken, map(intake.take, scans), strict=True):
        assert repr(scan) == repr(expected)
        if scan is not None:
            assert scan.ranges.base is None
            np.testing.assert_array_equal(scan.ranges, expected.ranges)
    assert together == alone
    assert together.dropped == {"empty": 2, "duplicate": 1}


@pytest.mark.parametrize(("beams", "fan_deg", "step"), [(180, 180.0, "1"), (360, 180.0, "0.5"), (360, 360.0, "1")])
def test_a_stretched_fan_causes_a_warning(beams, fan_deg, step):
    warning = angle_warning(beams, math.radians(fan_deg / (beams - 1)))
    assert warning is not None
    assert f"pass --angle-step-deg {step}" in warning
    assert is_explained(warning)


@pytest.mark.parametrize(
    ("beams", "step_deg"),
    [(180, 1.0), (181, 1.0), (361, 0.5), (1081, 0.25), (1040, 0.25), (361, 1.0), (682, 0.352), (1, 1)],
)
def test_true_fans_are_not(beams, step_deg):
    assert angle_warning(beams, math.radians(step_deg)) is None
    assert angle_warning(beams, -math.radians(step_deg)) is None


@pytest.mark.parametrize(("beams", "step"), [(181, 1.0), (361, -0.5), (720, 0.5), (1081, 0.25), (121, 0.25)])
def test_degrees_are_distinguished_from_radians(beams, step):
    assert are_degrees(beams, step)
    assert not are_degrees(beams, math.radians(step))


def test_degrees_cause_a_warning():
    assert (
        angle_warning(361, 0.5) == "the scans state 361 beams 0.5 rad apart, 29 turns: their angles are read as degrees"
    )


def test_more_than_a_full_turn_causes_a_warning():
    warning = angle_warning(360, math.radians(1.03))
    assert warning is not None
    assert warning.endswith("more than a turn: if these span one turn, pass --angle-step-deg 1")
    assert is_explained(warning)
