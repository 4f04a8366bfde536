import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure import heading_chain
from tbmslam.loop_closure.heading_chain import HeadingChain
from tbmslam.optimisation.pose_graph import MotionEdge

STEP = 0.01  # [rad]


def closures_of(ends, turn=0.0, deviation=1e-4):
    information = np.diag([1.0, 1.0, deviation**-2.0])
    return [MotionEdge(source, target, SE2(0.0, 0.0, turn), information) for source, target in ends]


def chain_of(turns, deviation=STEP):
    return HeadingChain(np.asarray(turns), np.full(len(turns), deviation**2))


@pytest.fixture
def certain(monkeypatch):
    monkeypatch.setattr(heading_chain, "_PRIOR_LOOPS", 0.0)


def test_independent_errors_are_as_expected(certain):
    loops = closures_of([(40 * k, 40 * k + 40) for k in range(300)])
    walk = np.random.default_rng(1).normal(0.0, STEP, 12000)
    assert chain_of(walk).drift(loops) == pytest.approx(1.0, abs=0.2)


def test_errors_that_cancel_are_less_and_errors_of_one_sign_are_more(certain):
    loops = closures_of([(0, 400), (400, 800)])
    assert chain_of(STEP * (-1.0) ** np.arange(800)).drift(loops) < 1e-3
    assert chain_of(np.full(800, 0.1 * STEP)).drift(loops) == pytest.approx(4.0, rel=1e-3)


def test_the_wrap_of_headings_does_not_count():
    turns = np.full(628, 0.01)
    assert chain_of(turns).drift(closures_of([(0, 628)], turn=-0.0032)) < 0.15


def test_the_closures_direction_does_not_count(certain):
    turns = np.full(100, STEP)
    forth, back = closures_of([(0, 100)], turn=0.9), closures_of([(100, 0)], turn=-0.9)
    assert chain_of(turns).drift(forth) == pytest.approx(1.0, rel=1e-3)
    assert chain_of(turns).drift(back) == pytest.approx(chain_of(turns).drift(forth))


def test_a_closure_shows_no_error_below_its_own_noise(certain):
    assert chain_of(np.zeros(100)).drift(closures_of([(0, 100)], deviation=0.05)) == pytest.approx(0.25)


def test_a_loop_counts_once_however_often_it_is_closed():
    """So that the stated variances keep their weight against it."""
    exact = chain_of(np.zeros(1000))
    once = exact.drift(closures_of([(0, 100)]))
    assert once == pytest.approx(0.1 / 1.1, rel=1e-2)
    assert exact.drift(closures_of([(0, 100)] * 50)) == pytest.approx(once)
    assert exact.drift(closures_of([(100 * k, 100 * k + 100) for k in range(10)])) == pytest.approx(0.1 / 10.1, rel=0.1)


def test_nothing_is_known_without_closures_or_with_unknown_turns():
    variances = np.full(100, STEP**2)
    variances[50] = np.inf
    turns = np.where(np.isinf(variances), np.nan, 0.0)
    assert chain_of(np.zeros(100)).drift([]) == 1.0
    assert HeadingChain(turns, variances).drift(closures_of([(0, 100), (30, 51), (50, 60)])) == 1.0
    assert HeadingChain(turns, variances).drift(closures_of([(0, 50), (51, 100)])) < 0.2


def test_many_closures_are_thinned_evenly(monkeypatch):
    monkeypatch.setattr(heading_chain, "_MOST_CLOSURES", 10)
    turns = np.concatenate((np.zeros(500), np.full(500, 10.0 * STEP)))
    early, late = [(k, k + 50) for k in range(0, 450, 5)], [(k, k + 50) for k in range(500, 950, 5)]
    assert chain_of(turns).drift(closures_of(early + late)) > 10.0
    assert chain_of(turns).drift(closures_of(early)) < 0.2
