"""The progress of a long computation: the duration of each step and its state."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import Reading

T = TypeVar("T")


class Progress:
    """Measures the durations of steps and shows nothing; programs derive from it to show the progress.

    Attributes
    ----------
    seconds
        Duration of each step so far [s].
    """

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
        self, items: Iterable[T], step: str, total: int | None = None, unit: str = "", label: str = ""
    ) -> Iterator[T]:
        """Yield items, and add the time until the last one is used to a step.

        Parameters
        ----------
        items
            The items.
        step
            Name of the step.
        total, unit
            Largest number of items, if known, and their name.
        label
            Name of the step to show; the step's own if empty.
        """
        with self.during(step):
            yield from self.shown(items, label or step, total, unit)

    def saw(self, name: str, reading: Reading, T_map_robot: SE2) -> None:
        """Receive the pose of a robot at a reading; does nothing here."""

    def finished(self, name: str, tbm_map: TbmMap) -> None:
        """Receive the finished map of a robot; does nothing here."""

    def shown(self, items: Iterable[T], label: str, total: int | None, unit: str) -> Iterable[T]:
        """Return items that show their progress while they are used; here they show nothing."""
        del label, total, unit
        return items
