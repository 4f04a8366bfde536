import numpy as np

from datasets.recording import Recording, cached
from tbmslam.sensing.laser_scan import LaserScan, Reading


class Source:
    def __init__(self, number):
        self.number, self.passes = number, 0

    def stream(self, counts):
        self.passes += 1
        for k in range(self.number):
            counts.scans_read += 1
            counts.scans_used += 1
            yield Reading(LaserScan(float(k), 0.0, 0.1, 0.0, 9.0, np.ones(100)), None)

    def recording(self):
        return Recording("run", self.stream, {"kind": "test"}, self.number)


def test_a_small_recording_is_streamed_once():
    source = Source(10)
    recording = cached(source.recording())
    first, second = list(recording), list(recording)
    assert source.passes == 1
    assert all(a is b for a, b in zip(first, second, strict=True))
    assert recording.counts.scans_used == 10
    assert (recording.name, recording.expected_scans, recording.description) == ("run", 10, {"kind": "test"})


def test_a_large_recording_is_streamed_each_time(monkeypatch):
    monkeypatch.setattr("datasets.recording._CACHE_BYTES", 5000)
    source = Source(10)
    recording = cached(source.recording())
    assert [len(list(recording)) for _ in range(3)] == [10, 10, 10]
    assert source.passes == 3


def test_a_pass_broken_off_is_not_remembered():
    source = Source(10)
    recording = cached(source.recording())
    next(iter(recording))
    assert len(list(recording)) == 10
    assert source.passes == 2
