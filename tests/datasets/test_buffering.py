import threading
import time

import numpy as np
import pytest

from datasets import DatasetError
from datasets.buffering import read_ahead
from tbmslam.sensing.laser_scan import LaserScan, Reading

MOST_WAITING = 32 * 18  # blocks that wait, one that is being filled, one that waits for room


def reading(number):
    return Reading(LaserScan(float(number), 0.0, 0.1, 0.1, 30.0, np.ones(3)), None)


class Source:
    """Readings that note how many were read, by whom, and whether their source was closed."""

    def __init__(self, number, error=None):
        self.number, self.error = number, error
        self.read, self.closed, self.threads = 0, False, set()

    def __iter__(self):
        try:
            for number in range(self.number):
                self.read += 1
                self.threads.add(threading.current_thread().name)
                yield reading(number)
            if self.error is not None:
                raise self.error
        finally:
            self.closed = True


def nobody_reads():
    return not any(thread.name == "reading ahead" for thread in threading.enumerate())


@pytest.mark.parametrize("number", [0, 1, 31, 32, 33, 2000])
def test_the_same_readings_in_the_same_order(number):
    source = Source(number)
    assert [one.scan.stamp for one in read_ahead(source)] == list(range(number))
    assert source.closed
    assert source.threads <= {"reading ahead"}
    assert nobody_reads()


def test_what_waits_is_bounded():
    source = Source(100_000)
    readings = read_ahead(source)
    next(readings)
    before = -1
    while source.read > before:
        before = source.read
        time.sleep(0.1)
    assert 32 < source.read <= MOST_WAITING
    readings.close()
    assert source.closed
    assert nobody_reads()


def test_what_goes_wrong_is_raised_after_what_was_read_before():
    for error in (DatasetError("run.bag: the disk is gone"), MemoryError("no more")):
        seen = []
        with pytest.raises(type(error), match=str(error)):
            seen.extend(one.scan.stamp for one in read_ahead(Source(70, error)))
        assert seen == list(range(70))
        assert nobody_reads()


def test_who_breaks_off_waits_for_nobody():
    def interrupt(readings):
        for one in readings:
            if one.scan.stamp == 40.0:
                raise KeyboardInterrupt

    source = Source(5000)
    with pytest.raises(KeyboardInterrupt):
        interrupt(read_ahead(source))
    assert source.closed
    assert nobody_reads()


def test_ctrl_c_while_the_reader_begins_leaves_none(monkeypatch):
    begin = threading.Thread.start

    def interrupted(thread):
        begin(thread)
        raise KeyboardInterrupt

    source = Source(5000)
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            next(read_ahead(source))
    assert nobody_reads()
