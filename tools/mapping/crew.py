"""Who maps the robots: this process, several of them, or a cluster. The maps are the same."""

import logging
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.cluster import Cluster
from tbmslam.parallel.progress import Watch
from tbmslam.parallel.worker_pool import worker_pool
from tools.mapping.task import Mapped, MappingTask, Shelf, map_robot

logger = logging.getLogger(__name__)


class MappingError(TbmSlamError):
    """Some of several robots could not be mapped."""


def map_all(
    tasks: Sequence[MappingTask], shelf: Shelf, workers: int, scheduler: str | None, watch: Watch
) -> Iterator[tuple[MappingTask, Mapped]]:
    """Map robots and yield each when it is done, in their order.

    What fails does not keep the others from being mapped.

    Parameters
    ----------
    tasks
        The robots.
    shelf
        Recordings that this process has at hand.
    workers
        Processes to share the work, where there is no scheduler.
    scheduler
        Address of a Dask scheduler; None for this machine.
    watch
        Who is told how far it is.

    Raises
    ------
    TbmSlamError
        What went wrong where one robot was to be mapped, at the end.
    MappingError
        How many of several robots failed, and the first reason, at the end.
    """
    failures: dict[str, TbmSlamError] = {}
    with closing(_results(tasks, shelf, workers, scheduler, watch)) as results:
        for task, result in zip(tasks, results, strict=True):
            if not isinstance(result, TbmSlamError):
                yield task, result
                continue
            if len(tasks) > 1:
                logger.warning("%s: %s", task.name, result)
            failures[task.name] = result
    if failures and len(tasks) == 1:
        raise next(iter(failures.values()))
    if failures:
        names = ", ".join(failures)
        kept = ", the others are kept" if len(failures) < len(tasks) else ""
        first = next(iter(failures.values()))
        raise MappingError(
            f"{len(failures)} of {len(tasks)} robots failed ({names}){kept}; mend or leave out "
            f"their recordings and run again; the first: {first}"
        )


def _results(
    tasks: Sequence[MappingTask], shelf: Shelf, workers: int, scheduler: str | None, watch: Watch
) -> Generator[Mapped | TbmSlamError]:
    """Yield for each robot what was made or went wrong."""
    if scheduler is not None:
        with Cluster(scheduler) as cluster:
            submitted = [cluster.submit(task.name, _map_elsewhere, task.at(Path.cwd())) for task in tasks]
            for future in watch.each(submitted, "mapping", len(tasks), "robots"):
                yield _outcome(lambda future=future: next(cluster.results([future])))  # type: ignore[misc]
    elif min(workers, len(tasks)) <= 1:
        for task in tasks:
            yield _outcome(partial(map_robot, task, shelf, watch))
    else:
        with worker_pool(min(workers, len(tasks))) as pool:
            futures = [pool.submit(_map_elsewhere, task) for task in tasks]
            for future in watch.each(futures, "mapping", len(tasks), "robots"):
                yield _outcome(partial(pool.result, future))


def _outcome(mapping: Callable[[], Mapped]) -> Mapped | TbmSlamError:
    try:
        return mapping()
    except TbmSlamError as error:
        return error


def _map_elsewhere(task: MappingTask) -> Mapped:
    """Map a robot in a process of its own; the map itself stays in its folder."""
    made = map_robot(task, Shelf(), Watch())
    return Mapped(made.run, made.summary, made.seconds)
