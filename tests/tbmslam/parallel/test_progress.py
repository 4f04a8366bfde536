import pytest

from tbmslam.parallel.executor import Progress


def test_times_of_a_step_add_up(monkeypatch):
    clock = iter([0.0, 2.0, 10.0, 13.0, 20.0, 21.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    progress = Progress()
    with progress.during("fusing"):
        pass
    with progress.during("fusing"):
        pass
    assert list(progress.each("abc", "mapping", 3, "scans", "robot_0")) == ["a", "b", "c"]
    assert progress.seconds == {"fusing": 5.0, "mapping": 1.0}


def test_a_step_that_fails_took_its_time_too():
    progress = Progress()
    with pytest.raises(KeyError), progress.during("loading"):
        raise KeyError
    assert progress.seconds["loading"] >= 0.0
