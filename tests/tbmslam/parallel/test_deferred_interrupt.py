"""What a signal raises, raised where nothing is held that others wait for."""

import signal
import threading

import pytest

from tbmslam.parallel.deferred_interrupt import DeferredInterrupt


@pytest.fixture(autouse=True)
def on_a_terminal():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_is_raised_at_the_end_of_the_block_which_is_hurried():
    told = []

    def work():
        with DeferredInterrupt(lambda: told.append("hurry")) as interrupt:
            signal.raise_signal(signal.SIGINT)
            assert isinstance(interrupt.came, KeyboardInterrupt)
            told.append("end")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert told == ["hurry", "end"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_lock_that_is_being_taken_is_given_back():
    """A handler's exception between a lock's being taken and the block that gives it back leaves it taken."""
    condition = threading.Condition()
    enter = condition.__class__.__enter__

    def interrupted(self):
        taken = enter(self)
        signal.raise_signal(signal.SIGINT)
        return taken

    def work():
        with DeferredInterrupt(lambda: None), condition:
            pass

    condition.__class__ = type("Interrupted", (threading.Condition,), {"__enter__": interrupted})
    with pytest.raises(KeyboardInterrupt):
        work()
    other = threading.Thread(target=lambda: enter(condition), daemon=True)
    other.start()
    other.join(10.0)
    assert not other.is_alive()


def test_a_second_ctrl_c_is_raised_there_and_then():
    told = []

    def work():
        with DeferredInterrupt(lambda: told.append("hurry")):
            signal.raise_signal(signal.SIGINT)
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                told.append("second")
                raise

    with pytest.raises(KeyboardInterrupt):
        work()
    assert told == ["hurry", "second"]


def test_ctrl_c_comes_before_what_failed_because_of_it():
    def work():
        with DeferredInterrupt(lambda: None):
            signal.raise_signal(signal.SIGINT)
            raise ValueError("all workers have gone")

    with pytest.raises(KeyboardInterrupt) as caught:
        work()
    assert caught.value.__suppress_context__


def test_it_is_raised_once_where_the_block_gives_way_sooner():
    with DeferredInterrupt(lambda: None) as interrupt:
        interrupt.give_way()  # nothing has come
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.give_way()


def test_a_handler_that_raises_nothing_ends_nothing():
    heard = []
    signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    with DeferredInterrupt(lambda: heard.append("hurry")) as interrupt:
        signal.raise_signal(signal.SIGINT)
    assert heard == [signal.SIGINT]
    assert interrupt.came is None


def test_who_is_not_to_hear_ctrl_c_does_not():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with DeferredInterrupt(lambda: None):
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_another_thread_leaves_signals_to_the_main_one():
    kept = []

    def work():
        with DeferredInterrupt(lambda: None):
            kept.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert kept == [signal.default_int_handler]
