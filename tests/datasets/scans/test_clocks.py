import numpy as np
import pytest

from datasets.counts import ReadingCounts
from datasets.scans.clocks import ClockSteps, compare_clocks, lags_of_unset
from tests.warnings_page import is_explained

rng = np.random.default_rng(0)


def jitter(centre, spread=0.02, number=100):
    return list(centre + spread * rng.standard_normal(number))


def test_clocks_that_agree():
    found = compare_clocks(jitter(0.3), jitter(0.01))
    assert (found.offset, found.warning) == (0.0, None)
    assert found.steady_lag == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("fault", [82.2, -500.0])
def test_a_constant_fault_is_corrected(fault):
    found = compare_clocks(jitter(fault), jitter(0.0))
    assert found.offset == pytest.approx(fault, abs=0.02)
    assert found.warning is not None
    assert "corrected" in found.warning
    assert is_explained(found.warning)


def test_the_time_that_a_scan_takes_is_no_clock_s_fault():
    found = compare_clocks(jitter(82.218), jitter(0.0), 0.018)
    assert found.offset == pytest.approx(82.2, abs=0.01)


def test_both_clocks_may_be_far_from_the_bag():
    assert compare_clocks(jitter(1e6), jitter(1e6)).offset == 0.0


def test_seconds_may_be_latency():
    found = compare_clocks(jitter(2.5), jitter(0.0))
    assert found.offset == 0.0
    assert found.warning is not None
    assert "treated as latency: pass --clock-offset" in found.warning
    assert is_explained(found.warning)


@pytest.mark.parametrize("lags", [(jitter(80.0, 5.0), jitter(0.0)), (jitter(80.0), jitter(0.0, 5.0))])
def test_a_varying_offset_is_reported_and_not_corrected(lags):
    found = compare_clocks(*lags)
    assert found.offset == 0.0
    assert found.warning is not None
    assert "varies, and was not corrected: pass --clock-offset" in found.warning
    assert is_explained(found.warning)


def test_too_little_to_tell():
    assert compare_clocks([82.0] * 3, [0.0] * 100) == (0.0, None, None)
    assert compare_clocks([82.0] * 30, [0.0] * 3) == (0.0, 82.0, None)


def test_unset_stamps_count_as_the_others_lag():
    assert lags_of_unset([], []) == (0.0, 0.0)
    assert lags_of_unset([5.0, 5.2, 9.0], []) == (5.2, 5.2)
    assert lags_of_unset([], [7.0]) == (7.0, 7.0)
    assert lags_of_unset([5.0], [7.0]) == (5.0, 7.0)


@pytest.mark.parametrize(("fault", "words"), [(2.5, "lag 2.5"), (-2.5, "are 2.5")])
def test_a_clock_that_is_ahead_is_reported_as_ahead(fault, words):
    warning = compare_clocks([fault] * 20, [0.0] * 20).warning
    assert warning is not None
    assert warning.startswith(f"stamps of the scans {words}0 s {'behind' if fault > 0 else 'ahead of'} those of the ")


def corrected(stamps, bag_times, steady_lag=0.02):
    counts = ReadingCounts()
    steps = ClockSteps(steady_lag, counts)
    return [steps.corrected(*pair) for pair in zip(stamps, bag_times, strict=True)], counts


TIMES = [100.0 + 0.1 * k for k in range(30)]
RECORDED = [stamp + 0.02 for stamp in TIMES]


@pytest.mark.parametrize("step", [-3.0, 3.0, -82.2])
def test_a_clock_that_is_set_wrong_for_a_while_is_set_right(step):
    stamps = [stamp + step * (10 <= k < 20) for k, stamp in enumerate(TIMES)]
    found, counts = corrected(stamps, RECORDED)
    assert found == pytest.approx(TIMES)
    assert counts.clock_disagreements == 10
    (incident,) = counts.incidents
    assert incident.text(100.0) == (
        "at 1.0 s: the clock of the scans is wrong; the recorder's clock is used, for 0.9 s"
    )


def test_a_busy_recorder_leaves_the_stamps_right():
    late = [max(time, 103.0) if k >= 10 else time for k, time in enumerate(RECORDED)]
    found, counts = corrected(TIMES, late)
    assert found == TIMES
    assert counts.clock_disagreements == 0  # the stamps are used
    assert len(counts.incidents) == 0


def test_a_pause_is_no_step():
    stamps = [*TIMES, *(stamp + 60.0 for stamp in TIMES)]
    found, counts = corrected(stamps, [stamp + 0.02 for stamp in stamps])
    assert found == stamps
    assert counts.clock_disagreements == 0


def test_where_the_lag_varies_nothing_is_corrected():
    assert corrected([1.0, -50.0], [1.0, 1.1], None)[0] == [1.0, -50.0]


def slower(rate, number=3000):
    """Return stamps of a clock that runs at a rate, and the bag times by the recorder's clock."""
    return [20.0 + 0.1 * rate * k for k in range(number)], [1000.0 + 0.1 * k for k in range(number)]


@pytest.mark.parametrize("rate", [0.97, 1.03, 0.6, 3.0])
def test_a_clock_that_is_slower_or_faster_is_no_step(rate):
    stamps, bag_times = slower(rate)
    found, counts = corrected(stamps, bag_times, 980.0)
    assert found == stamps
    assert (counts.clock_disagreements, len(counts.incidents)) == (0, 0)


def test_a_step_after_a_long_drift_is_removed():
    stamps, bag_times = slower(0.97)
    found, counts = corrected([s + 7.0 * (2000 <= k < 2100) for k, s in enumerate(stamps)], bag_times, 980.0)
    assert found == pytest.approx(stamps, abs=0.5)
    assert found[:2000] == stamps[:2000]
    assert counts.clock_disagreements == 100


def test_scans_that_come_late_now_and_then_do_not_move_the_clock():
    late = [time + 0.9 * (k % 10 == 0) for k, time in enumerate(RECORDED)]
    stamps = [*TIMES[:-1], TIMES[-1] + 30.0]
    found, _ = corrected(stamps, late)
    assert found[-1] == pytest.approx(TIMES[-1], abs=0.03)


def test_where_the_clocks_drift_far_apart_no_step_is_corrected():
    """A simulation that slows down to half speed: the clock of the recorder is no measure any more."""
    stamps, bag_times = slower(0.5)
    stamps = [stamp - 3.0 * (2000 <= k < 2100) for k, stamp in enumerate(stamps)]
    found, counts = corrected(stamps, bag_times, 980.0)
    assert found == stamps
    assert (counts.clock_disagreements, len(counts.incidents)) == (0, 0)


def test_after_a_busy_recorder_a_step_is_removed():
    late = [max(time, 101.5) if k >= 2 else time for k, time in enumerate(RECORDED)]
    stamps = [stamp + 3.0 * (k >= 25) for k, stamp in enumerate(TIMES)]
    found, counts = corrected(stamps, late)
    assert found == pytest.approx(TIMES, abs=0.03)
    assert counts.clock_disagreements == 5
