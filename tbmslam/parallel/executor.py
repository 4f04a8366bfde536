"""Runs many calls and reports their progress: in this process, in several, or on a Dask cluster.

On processors of one kind the results are equal.
"""

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.cluster import Cluster
from tbmslam.parallel.worker_pool import worker_pool
from tbmslam.sensing.laser_scan import Reading

_T = TypeVar("_T")


class Progress:
    """Measures the `seconds` of each step and shows nothing; programs derive from it to show the progress."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def during(self, step: str) -> Iterator[None]:
        """Add the duration of a block to a step."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - began

    def each(
        self, items: Iterable[_T], step: str, total: int | None = None, unit: str = "", label: str = ""
    ) -> Iterator[_T]:
        """Yield items, and add the time until the last one is used to a step.

        `total` is the largest number of items, if known, `unit` their name, and `label` the shown name of the step.
        """
        with self.during(step):
            yield from self.shown(items, label or step, total, unit)

    def saw(self, name: str, reading: Reading, T_map_robot: SE2) -> None:
        """Receive the pose of a robot at a reading; does nothing here."""

    def finished(self, name: str, tbm_map: TbmMap) -> None:
        """Receive the finished map of a robot; does nothing here."""

    def told_in_workers(self) -> Callable[[], object] | None:
        """Return a function of a module that the first worker calls before its work, to tell of it; None here."""
        return None

    def shown(self, items: Iterable[_T], label: str, total: int | None, unit: str) -> Iterable[_T]:
        """Return items that show their progress while they are used; here they show nothing."""
        del label, total, unit
        return items


@dataclass(frozen=True)
class Call:
    """A call to run."""

    name: str
    """Unique among the calls that run together."""
    function: Callable[..., Any]
    """A function of a module; another process imports it by its name."""
    arguments: tuple[object, ...] = ()
    """Plain values, or other calls as inputs: their results are passed. Calls share an input by its name; it runs once
    in each process, or once on a cluster, and its result must not be changed."""


@dataclass(frozen=True)
class Executor:
    """Runs calls and shows their progress."""

    workers: int = 1
    """Number of processes on this machine."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers run the calls; None for this machine."""
    progress: Progress = field(default_factory=Progress)
    """Receives the duration of each step and its progress."""

    def __post_init__(self) -> None:
        """Check the number of workers."""
        if self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")

    def is_serial(self, count: int) -> bool:
        """Return whether this process itself runs this number of calls."""
        return self.scheduler is None and min(self.workers, count) <= 1

    def results(
        self, calls: Sequence[Call], step: str = "", unit: str = "", most_inputs: int | None = None
    ) -> list[Any]:
        """Return the results of calls, in their order; the first failure ends all.

        The progress shows the step with the unit of its items, if given. A local process keeps the `most_inputs` most
        recent inputs, those of its present call included, and computes dropped ones again; None keeps all. Raises the
        `TbmSlamError` of a call, a `ClusterError` if the cluster fails, or a `WorkerDiedError` if a local process died.
        """
        made = []
        with closing(self.outcomes(calls, step, unit, most_inputs)) as outcomes:
            for outcome in outcomes:
                if isinstance(outcome, TbmSlamError):
                    raise outcome
                made.append(outcome)
        return made

    def outcomes(
        self, calls: Sequence[Call], step: str = "", unit: str = "", most_inputs: int | None = None
    ) -> Generator[Any]:
        """Yield the result of each call, or the `TbmSlamError` that it raised; see `results`."""
        if self.scheduler is not None:
            with Cluster(self.scheduler) as cluster:
                inputs = {name: cluster.submit(name, call.function, *call.arguments) for name, call in _inputs(calls)}
                futures = [cluster.submit(call.name, call.function, *_resolved(call, inputs.get)) for call in calls]
                for future in self._shown(futures, step, unit):
                    yield _outcome(partial(cluster.result, future))
        elif self.is_serial(len(calls)):
            made = _MadeInputs(dict(_inputs(calls)), most_inputs)
            for call in self._shown(calls, step, unit):
                yield _outcome(partial(made.call, call))
        else:
            with worker_pool(
                min(self.workers, len(calls)), partial(_initialise, dict(_inputs(calls)), most_inputs)
            ) as pool:
                begin = self.progress.told_in_workers()
                submitted = [
                    pool.submit(_call_here, _referring(call), None if index else begin)
                    for index, call in enumerate(calls)
                ]
                for future in self._shown(submitted, step, unit):
                    yield _outcome(partial(pool.result, future))

    def _shown(self, items: Sequence[_T], step: str, unit: str) -> Iterable[_T]:
        return self.progress.each(items, step, len(items), unit) if step else items


class _MadeInputs:
    """Inputs of calls, each computed at its first use by the call of its name.

    The `most` recent ones are kept, those of the present call included; None keeps all.
    """

    def __init__(self, inputs: Mapping[str, Call], most: int | None = None) -> None:
        self._inputs, self._most = inputs, most
        self._made: dict[str, object] = {}

    def call(self, call: Call) -> Any:
        """Run a call."""
        return call.function(*_resolved(call, self._input))

    def _input(self, name: str) -> object:
        if name in self._made:
            made = self._made.pop(name)
        else:
            while self._most is not None and len(self._made) >= self._most:
                del self._made[next(iter(self._made))]
            call = self._inputs[name]
            made = call.function(*call.arguments)
        self._made[name] = made  # the most recent input is last and is dropped last
        return made


_here: list[_MadeInputs] = []
"""The inputs of the calls, if this process is a worker."""


def _initialise(inputs: Mapping[str, Call], most: int | None) -> None:
    _here[:] = [_MadeInputs(inputs, most)]


def _call_here(call: Call, begin: Callable[[], object] | None = None) -> Any:
    if begin is not None:
        begin()
    return _here[0].call(call)


def _inputs(calls: Iterable[Call]) -> Iterable[tuple[str, Call]]:
    found = (argument for call in calls for argument in call.arguments if isinstance(argument, Call))
    return {call.name: call for call in found}.items()


def _resolved(call: Call, made: Callable[[str], object]) -> list[object]:
    """Return the arguments of a call, with the results of its inputs."""
    return [made(value.name) if isinstance(value, Call) else value for value in call.arguments]


def _referring(call: Call) -> Call:
    """Return a call that holds only the names of its inputs: workers have the inputs."""
    arguments = (Call(value.name, _call_here) if isinstance(value, Call) else value for value in call.arguments)
    return Call(call.name, call.function, tuple(arguments))


def _outcome(making: Callable[[], Any]) -> Any:
    try:
        return making()
    except TbmSlamError as error:
        return error
