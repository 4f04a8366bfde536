"""Who maps the robots: this process, several of them, or a cluster. The maps are the same."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Call, Executor
from tbmslam.parallel.progress import Watch
from tools.mapping.task import Mapped, MappingTask, Shelf, map_robot

logger = logging.getLogger(__name__)


class MappingError(TbmSlamError):
    """Some of several robots could not be mapped."""


def map_all(tasks: Sequence[MappingTask], shelf: Shelf, executor: Executor) -> Iterator[tuple[MappingTask, Mapped]]:
    """Map robots and yield each when it is done, in their order.

    What fails does not keep the others from being mapped.

    Parameters
    ----------
    tasks
        The robots.
    shelf
        Recordings that this process has at hand.
    executor
        What maps them.

    Raises
    ------
    TbmSlamError
        What went wrong where one robot was to be mapped, at the end.
    MappingError
        How many of several robots failed, and the first reason, at the end.
    """
    failures: dict[str, TbmSlamError] = {}
    step = "" if executor.is_serial(len(tasks)) else "mapping"  # in this process each robot shows its own
    with closing(executor.outcomes(_calls(tasks, shelf, executor), step, "robots")) as results:
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


def _calls(tasks: Sequence[MappingTask], shelf: Shelf, executor: Executor) -> list[Call]:
    if executor.is_serial(len(tasks)):
        return [Call(task.name, map_robot, (task, shelf, executor.watch)) for task in tasks]
    if executor.scheduler is not None:
        tasks = [task.at(Path.cwd()) for task in tasks]
    return [Call(task.name, _map_elsewhere, (task,)) for task in tasks]


def _map_elsewhere(task: MappingTask) -> Mapped:
    """Map a robot in a process of its own; the map itself stays in its folder."""
    made = map_robot(task, Shelf(), Watch())
    return Mapped(made.run, made.summary, made.seconds)
