import pytest

from tbmslam.parallel.progress import Watch


def test_times_of_a_step_add_up(monkeypatch):
    clock = iter([0.0, 2.0, 10.0, 13.0, 20.0, 21.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    watch = Watch()
    with watch.during("fusing"):
        pass
    with watch.during("fusing"):
        pass
    assert list(watch.each("abc", "mapping", 3, "scans", "robot_0")) == ["a", "b", "c"]
    assert watch.seconds == {"fusing": 5.0, "mapping": 1.0}


def test_a_step_that_fails_took_its_time_too():
    watch = Watch()
    with pytest.raises(KeyError), watch.during("loading"):
        raise KeyError
    assert watch.seconds["loading"] >= 0.0
