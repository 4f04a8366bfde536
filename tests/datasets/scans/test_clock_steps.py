import pytest

from datasets.counts import ReadingCounts
from datasets.scans.clock_steps import ClockSteps


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
        "at 1.0 s: the clock of the scans is set wrong, corrected by the recorder's, for 0.9 s"
    )


def test_a_busy_recorder_leaves_the_stamps_right():
    late = [max(time, 103.0) if k >= 10 else time for k, time in enumerate(RECORDED)]
    found, counts = corrected(TIMES, late)
    assert found == TIMES
    assert counts.clock_disagreements > 0
    assert len(counts.incidents) == 0


def test_a_pause_is_no_step():
    stamps = [*TIMES, *(stamp + 60.0 for stamp in TIMES)]
    found, counts = corrected(stamps, [stamp + 0.02 for stamp in stamps])
    assert found == stamps
    assert counts.clock_disagreements == 0


def test_where_the_lag_varies_nothing_is_corrected():
    assert corrected([1.0, -50.0], [1.0, 1.1], None)[0] == [1.0, -50.0]
