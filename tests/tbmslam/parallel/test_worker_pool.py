"""Processes that share work, and how they end."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from pathlib import Path

import pytest

from tbmslam.parallel.worker_pool import DeferredInterrupt, WorkerDiedError, in_threads, worker_pool


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


def test_ctrl_c_takes_precedence_over_errors_that_it_caused():
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


ROOT = Path(__file__).resolve().parents[3]

WORK_FOR_EVER = """
import sys, time
from tbmslam.parallel.worker_pool import worker_pool
if __name__ == "__main__":
    with worker_pool(2) as pool:
        waiting = [pool.submit(time.sleep, 600) for _ in range(9)]
        try:
            print("ready", flush=True)
            pool.result(waiting[0])
        except KeyboardInterrupt:
            print("interrupted", flush=True)
            raise SystemExit(130)
"""


AS_IT_BEGINS_TO_WAIT = """
import os, signal, sys, time
from tbmslam.parallel.worker_pool import worker_pool

def interrupt(frame, event, arg):
    if event == "c_return" and frame.f_code.co_qualname == "Condition.__enter__":
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGINT)

if __name__ == "__main__":
    try:
        with worker_pool(1) as pool:
            work = pool.submit(time.sleep, 600)
            sys.setprofile(interrupt)
            work.result()
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


TELLS_ITS_WORKER = """
import os, time
from tbmslam.parallel.worker_pool import worker_pool
if __name__ == "__main__":
    with worker_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""


def test_work_is_done_in_other_processes():
    with worker_pool(2) as pool:
        assert list(pool.map(abs, [-1, 2, -3])) == [1, 2, 3]
        assert pool.submit(os.getpid).result() != os.getpid()
    assert multiprocessing.active_children() == []


def test_workers_ignore_ctrl_c_also_where_no_signal_can_be_blocked(monkeypatch):
    monkeypatch.setattr("tbmslam.parallel.worker_pool.interrupts_held", nullcontext)  # as on Windows
    with worker_pool(1) as pool:
        assert pool.submit(signal.getsignal, signal.SIGINT).result() is signal.SIG_IGN


def test_more_workers_than_windows_can_wait_for_are_not_started(monkeypatch):
    monkeypatch.setattr("sys.platform", "win32")
    with worker_pool(62) as pool:
        assert pool._max_workers == 61


def test_a_dead_process_is_reported_in_one_line():
    with pytest.raises(WorkerDiedError, match=r"a worker process died, .*fewer --workers"), worker_pool(1) as pool:
        pool.submit(os._exit, 3).result()


def test_a_dead_process_of_a_worker_is_reported_by_the_worker():
    error = pickle.loads(pickle.dumps(WorkerDiedError()))  # noqa: S301 - as a worker does
    assert isinstance(error, WorkerDiedError)
    assert str(error) == str(WorkerDiedError())


def test_what_fails_does_not_wait_for_the_rest():
    began = time.monotonic()
    with pytest.raises(TypeError, match="not callable"), worker_pool(1) as pool:
        assert pool.submit(time.sleep, 600)()
    assert time.monotonic() - began < 60
    assert multiprocessing.active_children() == []


def test_ctrl_c_before_there_is_a_worker_lets_none_begin():
    taken = []

    def work():
        with worker_pool(1) as pool:
            signal.raise_signal(signal.SIGINT)
            taken.append(pool.submit(time.sleep, 0.0))

    with pytest.raises(KeyboardInterrupt):
        work()
    assert taken == []
    assert multiprocessing.active_children() == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("after", [0.0, 0.1, 1.0])
def test_ctrl_c_ends_all_processes_with_one_message(tmp_path, after):
    """A shell sends it to every process; after no time the workers are still beginning."""
    script = tmp_path / "work.py"
    script.write_text(WORK_FOR_EVER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen(  # noqa: S603 - our own script
        [sys.executable, script],
        env=environment,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - a background shell ignores it
        **pipes,
    )
    assert child.stdout is not None
    child.stdout.readline()
    time.sleep(after)
    os.killpg(child.pid, signal.SIGINT)
    said = child.communicate(timeout=60)
    assert (child.returncode, *said) == (130, "interrupted\n", "")


def test_ctrl_c_does_no_harm_where_a_lock_was_just_taken(tmp_path):
    """The pool's own thread takes it too, and what ends the pool waits for that thread."""
    script = tmp_path / "work.py"
    script.write_text(AS_IT_BEGINS_TO_WAIT)
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, script],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_if_their_parent_is_killed(tmp_path, how):
    """They hold the pipe open that they read from, so they would wait for ever."""
    script = tmp_path / "work.py"
    script.write_text(TELLS_ITS_WORKER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(  # noqa: S603 - our own script
        [sys.executable, script], env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as child:
        assert child.stdout is not None
        assert int(child.stdout.readline()) != child.pid
        child.send_signal(how)
        said, _ = child.communicate(timeout=60)  # which comes to an end with the last process that could write
    assert (child.returncode, said) == (-how, "")


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
