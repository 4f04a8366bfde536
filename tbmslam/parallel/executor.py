"""What makes many calls: this process, several of them, or a Dask cluster. The results are the same."""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.cluster import Cluster
from tbmslam.parallel.progress import Progress
from tbmslam.parallel.worker_pool import worker_pool

_T = TypeVar("_T")


@dataclass(frozen=True)
class Call:
    """A call to make.

    Parameters
    ----------
    name
        Its own among the calls made together.
    function
        A module's function; another process imports it by its name.
    arguments
        Plain values, or other calls: inputs, whose results it takes. Calls share an input by its name; it is made once
        in each process, or once in a cluster, and must not be changed.
    """

    name: str
    function: Callable[..., Any]
    arguments: tuple[object, ...] = ()


@dataclass(frozen=True)
class Executor:
    """What makes calls, and what shows how far they are.

    Parameters
    ----------
    workers
        Processes of this machine that share the work.
    scheduler
        Address of a Dask scheduler whose workers share it instead; None for this machine.
    progress
        Receives the duration of each step and its progress.

    Raises
    ------
    ValueError
        If there is no worker.
    """

    workers: int = 1
    scheduler: str | None = None
    progress: Progress = field(default_factory=Progress)

    def __post_init__(self) -> None:
        """Refuse to have nobody do it."""
        if self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")

    def is_serial(self, count: int) -> bool:
        """Return whether this process itself makes so many calls."""
        return self.scheduler is None and min(self.workers, count) <= 1

    def results(self, calls: Sequence[Call], step: str = "", unit: str = "") -> list[Any]:
        """Return what calls return, in their order; the first that fails ends all.

        Parameters
        ----------
        calls
            What to call.
        step, unit
            The step that progress is shown of, and what it counts; not shown where empty.

        Raises
        ------
        TbmSlamError
            What a call raised.
        ClusterError
            The cluster cannot be reached or gave up.
        WorkerDiedError
            A process of this machine died.
        """
        made = []
        with closing(self.outcomes(calls, step, unit)) as outcomes:
            for outcome in outcomes:
                if isinstance(outcome, TbmSlamError):
                    raise outcome
                made.append(outcome)
        return made

    def outcomes(self, calls: Sequence[Call], step: str = "", unit: str = "") -> Generator[Any]:
        """Yield what each call returns, or the `TbmSlamError` that it raises; see `results`."""
        if self.scheduler is not None:
            with Cluster(self.scheduler) as cluster:
                inputs = {name: cluster.submit(name, one.function, *one.arguments) for name, one in _inputs(calls)}
                futures = [cluster.submit(call.name, call.function, *_resolved(call, inputs.get)) for call in calls]
                for future in self._shown(futures, step, unit):
                    yield _outcome(lambda future=future: next(cluster.results([future])))  # type: ignore[misc]
        elif self.is_serial(len(calls)):
            made = _MadeInputs(dict(_inputs(calls)))
            for call in self._shown(calls, step, unit):
                yield _outcome(partial(made.call, call))
        else:
            with worker_pool(min(self.workers, len(calls)), partial(_initialise, dict(_inputs(calls)))) as pool:
                submitted = [pool.submit(_call_here, _referring(call)) for call in calls]
                for future in self._shown(submitted, step, unit):
                    yield _outcome(partial(pool.result, future))

    def _shown(self, items: Sequence[_T], step: str, unit: str) -> Iterable[_T]:
        return self.progress.each(items, step, len(items), unit) if step else items


class _MadeInputs:
    """Inputs of calls, each made when it is first asked for.

    Parameters
    ----------
    inputs
        The calls that make them, by name.
    """

    def __init__(self, inputs: Mapping[str, Call]) -> None:
        self._inputs = inputs
        self._made: dict[str, object] = {}

    def call(self, call: Call) -> Any:
        """Make a call."""
        return call.function(*_resolved(call, self._input))

    def _input(self, name: str) -> object:
        if name not in self._made:
            one = self._inputs[name]
            self._made[name] = one.function(*one.arguments)
        return self._made[name]


_here: list[_MadeInputs] = []
"""Where this process is a worker: the inputs of its calls."""


def _initialise(inputs: Mapping[str, Call]) -> None:
    _here[:] = [_MadeInputs(inputs)]


def _call_here(call: Call) -> Any:
    return _here[0].call(call)


def _inputs(calls: Iterable[Call]) -> Iterable[tuple[str, Call]]:
    found = (argument for call in calls for argument in call.arguments if isinstance(argument, Call))
    return {one.name: one for one in found}.items()


def _resolved(call: Call, made: Callable[[str], object]) -> list[object]:
    """Return a call's arguments, inputs replaced by what was made of them."""
    return [made(one.name) if isinstance(one, Call) else one for one in call.arguments]


def _referring(call: Call) -> Call:
    """Return a call whose inputs are names only: workers have the rest."""
    arguments = (Call(one.name, _call_here) if isinstance(one, Call) else one for one in call.arguments)
    return Call(call.name, call.function, tuple(arguments))


def _outcome(making: Callable[[], Any]) -> Any:
    try:
        return making()
    except TbmSlamError as error:
        return error
