import pytest

from datasets.odometry.pose_buffer import PoseHistory
from datasets.odometry.se3 import SE3


def at(x):
    return SE3(x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def filled(*samples, capacity=1000):
    history = PoseHistory(capacity)
    for stamp, x in samples:
        history.add(stamp, at(x))
    return history


def x_at(history, stamp, longest_gap=10.0, limit=0.2):
    found = history.at(stamp, longest_gap, limit)
    return None if found is None else (pytest.approx(found.pose.x), found.carried_on)


def test_interpolates_and_hits_exactly():
    history = filled((1.0, 0.0), (2.0, 1.0))
    assert x_at(history, 1.25) == (0.25, False)
    assert x_at(history, 2.0) == (1.0, False)
    assert x_at(history, 1.0) == (0.0, False)


def test_before_and_after():
    history = filled((1.0, 0.0), (1.5, 0.5))
    assert x_at(history, 0.99) is None
    assert x_at(history, 1.6) == (0.6, True)
    assert x_at(history, 1.8) is None
    assert x_at(PoseHistory(), 1.0) is None


def test_motion_across_a_long_pause_is_not_carried_on():
    assert x_at(filled((1.0, 0.0), (9.0, 8.0)), 9.1) == (8.0, True)


def test_long_gaps_are_not_interpolated():
    history = filled((1.0, 0.0), (9.0, 8.0))
    assert x_at(history, 5.0, longest_gap=2.0) is None
    assert x_at(history, 1.1, longest_gap=2.0) == (0.0, True)
    assert x_at(history, 8.9, longest_gap=2.0) == (8.0, True)


def test_a_clock_that_steps_back_keeps_the_newest_answer():
    history = filled((1.0, 0.0), (2.0, 1.0), (1.5, 10.0), (2.5, 11.0))
    assert x_at(history, 1.75) == (10.25, False)
    assert x_at(history, 1.25) == (0.25, False)
    assert history.reaches(2.5)
    assert not history.reaches(2.6)


def test_the_same_stamp_twice_means_the_newer_pose():
    assert x_at(filled((1.0, 0.0), (1.0, 5.0)), 1.0) == (5.0, False)


def test_memory_is_bounded():
    history = PoseHistory(10)
    for k in range(1000):
        history.add(k % 7 + 0.001 * k, at(float(k)))
    assert len(history._stamps) < 20
    assert x_at(history, history._stamps[-1]) == (999.0, False)


def test_nearest_holds_the_ends():
    history = filled((1.0, 0.0), (2.0, 1.0))
    assert [history.nearest(stamp).x for stamp in (0.0, 1.5, 3.0)] == pytest.approx([0.0, 0.5, 1.0])
    assert PoseHistory().nearest(1.0) is None


def test_capacity_is_checked():
    with pytest.raises(ValueError, match="capacity must be at least 2, got 1"):
        PoseHistory(1)
