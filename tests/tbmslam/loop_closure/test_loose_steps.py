import numpy as np
import pytest

from tbmslam.loop_closure.loose_steps import LooseSteps


def drive(*loose):
    """Return the loose steps of a straight drive of 10 keyframes; `loose` are the keyframes at their ends."""
    poses = np.column_stack((np.arange(10.0), np.zeros(10), np.zeros(10)))
    covariances = np.tile(np.diag([0.01, 0.01, 0.005]) ** 2, (9, 1, 1))
    for keyframe in loose:
        covariances[keyframe - 1] = np.diag([1.0, 0.6, 0.1]) ** 2
    return LooseSteps(poses, covariances)


def test_tracked_steps_widen_no_window():
    steps = drive()
    assert not len(steps.ends())
    assert not steps.windows(9, np.array([0, 4])).any()


def test_a_loose_step_widens_windows_across_it():
    steps = drive(5)
    assert steps.ends().tolist() == [5]
    across, beside = steps.windows(5, np.array([4, 7]))
    assert across == pytest.approx([3.0, 0.3], rel=0.02)
    assert beside == pytest.approx([0.0, 0.0], abs=1e-6)
    later = steps.windows(9, np.array([4]))[0]
    assert later[0] >= across[0]
    assert later[1] == pytest.approx(across[1])


def test_an_unknown_turn_is_searched_within_limits():
    steps = LooseSteps(np.zeros((3, 3)), np.tile(np.diag([1.0, 1.0, 4.0]) ** 2, (2, 1, 1)))
    assert steps.windows(2, np.array([0]))[0, 1] == pytest.approx(1.5)


def test_a_closure_bridges_the_loose_steps_that_it_spans():
    steps = drive(3, 7)
    steps.bridge(5, 2)
    assert steps.ends().tolist() == [7]
    assert not steps.windows(5, np.array([0])).any()
    assert steps.windows(8, np.array([0])).all()
    steps.bridge(9, 8)
    assert steps.ends().tolist() == [7]
    steps.bridge(8, 6)
    assert not steps.windows(8, np.array([0])).any()
