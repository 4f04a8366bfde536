from pathlib import Path

import numpy as np
import pytest

from datasets import Recording, RecordingOptions
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tools.mapping.task import Shelf, valid_json

PATHS, OPTIONS = (Path("run.bag"),), RecordingOptions()


@pytest.fixture
def opened(monkeypatch):
    """Return the passes over recordings that were opened."""
    passes = []

    def stream(counts):
        passes.append(counts)
        counts.scans_read = counts.scans_used = 1
        yield Reading(LaserScan(1.0, 0.0, 0.1, 0.1, 30.0, np.ones(3)), None)

    monkeypatch.setattr("tools.mapping.task.open_recording", lambda _paths, _options: Recording("run", stream, {}))
    return passes


def test_what_json_cannot_hold_is_null():
    record = {
        "first_scan": {"range_max_m": np.inf, "range_min_m": -np.inf},
        "ranges": [np.nan, 1.5],
        "name": "Infinity",
    }
    assert valid_json(record) == {
        "first_scan": {"range_max_m": None, "range_min_m": None},
        "ranges": [None, 1.5],
        "name": "Infinity",
    }


def test_a_recording_of_several_robots_is_read_once(opened):
    shelf = Shelf()
    for _ in range(3):
        assert len(list(shelf.open(PATHS, OPTIONS))) == 1
    assert len(opened) == 1
    assert len(list(shelf.open(PATHS, OPTIONS, once=True))) == 1
    assert len(opened) == 1
    list(shelf.open(PATHS, RecordingOptions(gap_s=3.0)))
    assert len(opened) == 2


def test_a_recording_that_is_read_once_is_not_kept(opened):
    shelf = Shelf()
    recording = shelf.open(PATHS, OPTIONS, once=True)
    assert [len(list(recording)), len(list(recording))] == [1, 1]
    assert len(opened) == 2
    assert shelf.open(PATHS, OPTIONS, once=True) is not recording
