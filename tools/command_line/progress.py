"""Progress on the terminal: a bar for each step, a line when code is compiled, and the viewer."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from typing import TYPE_CHECKING, Any, TypeVar

from numba.core.event import Listener, register
from tqdm import tqdm

from datasets.counts import in_number
from tbmslam.parallel.executor import Progress

if TYPE_CHECKING:
    from tbmslam.geometry.se2 import SE2
    from tbmslam.map.tbm_map import TbmMap
    from tbmslam.report.rerun_viewer import RerunViewer
    from tbmslam.sensing.laser_scan import Reading


_ANNOUNCEMENT = "compiling for this machine: a minute or two, the first time only"
_LONG_S = 5.0  # compilation time after which a log also gets the announcement [s]; a terminal gets it at once
_COUNTING = "{desc}: {n_fmt}/{total_fmt}{unit}{postfix}"
"""A bar while functions are compiled: the rate and the remaining time say nothing yet."""


class Compiling(Listener):
    """Announces that functions are compiled, and counts them on the bars.

    Where no bar is shown, a line of the terminal counts them while one is compiled. Functions from the cache are not
    compiled. The time of compilation does not count in the rate of a bar.
    """

    def __init__(self) -> None:
        self._is_announced = False
        self.count = 0
        """Number of functions compiled until now."""
        self._depth = 0
        self._began = self._seconds = 0.0
        self._bars: list[tqdm[Any]] = []
        self._line: tqdm[Any] | None = None

    @contextmanager
    def counted_on(self, bar: "tqdm[Any]") -> Iterator[None]:
        """Count the functions that are compiled within a block on a bar."""
        self._bars.append(bar)
        try:
            yield
        finally:
            self._bars.remove(bar)

    def on_start(self, event: Any) -> None:  # noqa: ARG002  # the name is numba's
        """Announce the first compilation above the bars; show the line where there is none."""
        if not self._depth:
            self._began = time.perf_counter()
        self._depth += 1
        if sys.stderr is not None and sys.stderr.isatty():
            self._announce()
            if not self._bars and self._line is None and parent_process() is None:  # a worker's parent has a bar
                self._line = tqdm(desc="compiling", bar_format="{desc}{postfix}", leave=False, postfix=self._counted())

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        """Count a function that is compiled; functions that it calls are compiled within its time."""
        self._depth -= 1
        self.count += 1
        if self._line is not None:
            self._line.set_postfix_str(self._counted())
        if not self._depth:
            self._seconds += time.perf_counter() - self._began
            self._remove_line()
        if self._seconds > _LONG_S:
            self._announce()
        for bar in self._bars:
            bar.unpause()
            bar.bar_format = _COUNTING
            bar.set_postfix_str(self._counted())

    def _counted(self) -> str:
        return in_number(self.count, "function compiled", "functions compiled") if self.count else ""

    def _remove_line(self) -> None:
        """Remove the line, for whatever the program prints next."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _announce(self) -> None:
        if not self._is_announced and sys.stderr is not None:
            self._is_announced = True
            tqdm.write(_ANNOUNCEMENT, file=sys.stderr)


_listeners: list[Compiling] = []


def announce_compiling() -> Compiling:
    """Announce the first compilation of this process; return the listener, which is the same for all calls."""
    if not _listeners:
        _listeners.append(Compiling())
        register("numba:compile", _listeners[0])
    return _listeners[0]


T = TypeVar("T")


class ProgressBars(Progress):
    """Shows a bar with rate and remaining time for each step of many items, if the output is a terminal.

    A viewer also shows the mapping.
    """

    def __init__(self, viewer: "RerunViewer | None" = None) -> None:
        super().__init__()
        self._compiling = announce_compiling()
        self._viewer = viewer

    def shown(self, items: Iterable[T], label: str, total: int | None, unit: str) -> Iterable[T]:
        """Yield items and update their bar."""
        bar = tqdm(items, desc=label, total=total, unit=f" {unit}", disable=None, leave=False)
        with self._compiling.counted_on(bar):
            for item in bar:
                yield item
                bar.bar_format = None  # also after the compilation of functions

    def told_in_workers(self) -> Callable[[], object]:
        """Return the function that lets a worker announce its compilations."""
        return announce_compiling

    def saw(self, name: str, reading: "Reading", T_map_robot: "SE2") -> None:
        """Pass a reading with its pose to the viewer."""
        if self._viewer is not None:
            self._viewer.saw(name, reading, T_map_robot)

    def finished(self, name: str, tbm_map: "TbmMap") -> None:
        """Pass a finished map to the viewer."""
        if self._viewer is not None:
            self._viewer.finished(name, tbm_map)
