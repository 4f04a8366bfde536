import threading

import pytest

from tbmslam.parallel.threads import in_threads


@pytest.mark.parametrize("cores", [None, 1, 2, 8])
def test_results_come_in_the_order_of_the_items(cores, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    assert in_threads(lambda item: item * item, range(20)) == [item * item for item in range(20)]
    assert in_threads(lambda item: item, []) == []


def test_two_cores_are_at_work_together(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    both = threading.Barrier(2, timeout=10.0)
    assert in_threads(lambda _: both.wait() >= 0, range(2)) == [True, True]


def test_an_error_is_that_of_the_call():
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 // item, [1, 0, 2])
