import os

import pytest

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Call, Executor, Progress, _MadeInputs
from tbmslam.parallel.worker_pool import WorkerDiedError


def made(value: int) -> tuple[int, object]:
    """Return an input, of which two are never the same object."""
    return value, object()


def total(first: tuple[int, object], second: tuple[int, object], factor: int) -> tuple[int, int, int]:
    """Return a sum, the inputs' identity and the process."""
    return factor * (first[0] + second[0]), id(first[1]), os.getpid()


def refused(reason: str) -> None:
    raise TbmSlamError(reason)


def test_somebody_has_to_do_the_work():
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        Executor(workers=0)


@pytest.mark.parametrize("workers", [1, 2])
def test_inputs_are_made_once_in_each_process_and_results_keep_their_order(workers):
    one, two = Call("one", made, (1,)), Call("two", made, (2,))
    calls = [Call(f"call {k}", total, (one, two, k)) for k in range(6)]
    executor = Executor(workers)
    results = executor.results(calls, "adding", "sums")
    assert [value for value, _, _ in results] == [0, 3, 6, 9, 12, 15]
    processes = {process for _, _, process in results}
    assert len({(identity, process) for _, identity, process in results}) == len(processes)
    assert (os.getpid() in processes) == executor.is_serial(len(calls)) == (workers == 1)
    assert list(executor.progress.seconds) == ["adding"]


@pytest.mark.parametrize("workers", [1, 2])
def test_one_call_that_fails_is_one_outcome_and_ends_all_results(workers):
    calls = [Call("a", abs, (-1,)), Call("b", refused, ("too dark",)), Call("c", abs, (-3,))]
    first, failure, last = Executor(workers).outcomes(calls)
    assert (first, str(failure), last) == (1, "too dark", 3)
    with pytest.raises(TbmSlamError, match=r"^too dark$"):
        Executor(workers).results(calls)


class Told(Progress):
    def told_in_workers(self):
        return tell


def tell():
    os.environ["TOLD"] = "yes"


def test_the_first_worker_tells_before_its_work():
    calls = [Call(name, os.getenv, ("TOLD",)) for name in ("a", "b")]
    assert Executor(2, progress=Told()).results(calls)[0] == "yes"
    assert Executor(1, progress=Told()).results(calls) == [None, None]


def test_a_worker_that_dies_is_one_clear_error():
    with pytest.raises(WorkerDiedError, match="a worker process died"):
        Executor(2).results([Call("a", os._exit, (3,)), Call("b", abs, (-1,))])


@pytest.mark.parametrize("workers", [1, 2])
def test_dropped_inputs_are_computed_again(workers):
    """Three inputs in turn, of which two are held: always the third one is asked for."""
    inputs = [Call(name, made, (number,)) for number, name in enumerate(["one", "two", "three"])]
    calls = [Call(f"call {k}", total, (inputs[k % 3], inputs[k % 3], 1)) for k in range(12)]
    found = Executor(workers).results(calls, most_inputs=2)
    assert [value for value, _, _ in found] == [0, 2, 4] * 4


def test_inputs_that_are_asked_for_again_are_held():
    calls = [Call("one", made, (1,)), Call("nothing", abs, (0,)), Call("three", made, (3,)), Call("four", made, (4,))]
    held = _MadeInputs({call.name: call for call in calls}, 2)
    one, nothing = (held.call(Call("call", lambda one: one, (call,))) for call in calls[:2])
    assert held.call(Call("call", lambda one: one, (calls[0],))) is one
    held.call(Call("call", lambda one: one, (calls[2],)))  # in place of the second
    assert held.call(Call("call", lambda one: one, (calls[0],))) is one
    assert nothing == 0
    held.call(Call("call", lambda *_: None, tuple(calls[2:])))
    assert held.call(Call("call", lambda one: one, (calls[0],))) is not one


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
