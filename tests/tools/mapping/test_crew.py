"""Who maps the robots."""

import os
import time
from pathlib import Path

import pytest

from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.parallel.executor import Executor
from tools.mapping import crew
from tools.mapping.crew import MappingError, map_all
from tools.mapping.task import Mapped, MappingTask, Shelf


def robot(name: str) -> MappingTask:
    return MappingTask(name, (), (), SlamConfig(), None, None, Path(name))


def dying_over_the_second(task: MappingTask) -> Mapped:
    """Map all but one, over which the process dies when the others are finished."""
    if task.name == "robot_1":
        time.sleep(1.0)
        os._exit(9)
    return Mapped({"robot": task.name})


def test_a_worker_that_dies_costs_its_robot_only(monkeypatch):
    monkeypatch.setattr(crew, "_map_elsewhere", dying_over_the_second)
    tasks = [robot(f"robot_{k}") for k in range(3)]
    done = []

    def work():
        done.extend(task.name for task, made in map_all(tasks, Shelf(), Executor(2)) if made.run)

    said = r"^1 of 3 robots failed \(robot_1\), the others are kept.*; the first: a worker process died: .*--workers$"
    with pytest.raises(MappingError, match=said):
        work()
    assert done == ["robot_0", "robot_2"]
