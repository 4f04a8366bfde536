"""Somebody to watch a long computation: how long each step takes, and how far it is."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import Reading

T = TypeVar("T")


class Progress:
    """Notes how long steps take, and shows nothing; programs derive from it and show what goes on.

    Attributes
    ----------
    seconds
        Time that passed in each step so far [s].
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def during(self, step: str) -> Iterator[None]:
        """Add the time of a block to a step."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - began

    def each(
        self, items: Iterable[T], step: str, total: int | None = None, unit: str = "", label: str = ""
    ) -> Iterator[T]:
        """Yield items, and add the time until they are used up to a step.

        Parameters
        ----------
        items
            What is worked through.
        step
            The step it is.
        total, unit
            How many there are at the most, where that is known, and what they are.
        label
            What to call them for people; the step's name where empty.
        """
        with self.during(step):
            yield from self.shown(items, label or step, total, unit)

    def saw(self, name: str, reading: Reading, T_map_robot: SE2) -> None:
        """Take note that a robot was placed at a pose by a reading; here nothing is done with it."""

    def finished(self, name: str, tbm_map: TbmMap) -> None:
        """Take note that a robot's map is finished; here nothing is done with it."""

    def shown(self, items: Iterable[T], label: str, total: int | None, unit: str) -> Iterable[T]:
        """Return items that show how far their use is; here they show nothing."""
        del label, total, unit
        return items
