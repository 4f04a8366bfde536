"""Progress on the terminal: a bar for each step, a line when code is compiled, and the viewer."""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self, TypeVar

from numba.core.event import Listener, register, unregister
from tqdm import tqdm

from tbmslam.parallel.progress import Progress

if TYPE_CHECKING:
    from tbmslam.geometry.se2 import SE2
    from tbmslam.map.tbm_map import TbmMap
    from tbmslam.report.rerun_viewer import RerunViewer
    from tbmslam.sensing.laser_scan import Reading


class Compiling(Listener):
    """Says that something is compiled, where stderr is a terminal, and counts it on the bars that are drawn.

    What comes from the cache is not compiled. The time that it takes is left out of a bar's rate and time left.
    """

    def __init__(self) -> None:
        self._is_said = False
        self._count = 0
        self._bars: list[tqdm[Any]] = []

    @contextmanager
    def counted_on(self, bar: "tqdm[Any]") -> Iterator[None]:
        """Count on a bar what is compiled within a block."""
        self._bars.append(bar)
        try:
            yield
        finally:
            self._bars.remove(bar)

    def on_start(self, event: Any) -> None:  # noqa: ARG002  # numba names it
        """Say so, above any bar that is drawn."""
        if not self._is_said and sys.stderr is not None and sys.stderr.isatty():
            self._is_said = True
            tqdm.write("compiling for this machine: a minute or two, the first time only", file=sys.stderr)

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        """Count a function that is compiled."""
        self._count += 1
        for bar in self._bars:
            bar.unpause()
            bar.set_postfix_str(f"{self._count} functions compiled")


class CompiledFunctions(Listener):
    """Counts the functions that are compiled within a block, without those from the cache."""

    def __init__(self) -> None:
        self.count = 0

    def on_start(self, event: Any) -> None:
        """Wait for the end."""

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        """Count a function that is compiled."""
        self.count += 1

    def __enter__(self) -> Self:
        """Begin to count."""
        register("numba:compile", self)
        return self

    def __exit__(self, *_: object) -> None:
        """Count no more."""
        unregister("numba:compile", self)


_listeners: list[Compiling] = []


def announce_compiling() -> Compiling:
    """Have a line written when this process first compiles, however often this is called; return what writes it."""
    if not _listeners:
        _listeners.append(Compiling())
        register("numba:compile", _listeners[0])
    return _listeners[0]


T = TypeVar("T")


class ProgressBars(Progress):
    """Shows a bar with rate and time left for every step of many items; nothing where the output is no terminal.

    Parameters
    ----------
    viewer        Shows the mapping; None for no viewer.
    """

    def __init__(self, viewer: "RerunViewer | None" = None) -> None:
        super().__init__()
        self._compiling = announce_compiling()
        self._viewer = viewer

    def shown(self, items: Iterable[T], label: str, total: int | None, unit: str) -> Iterable[T]:
        """Return items that draw their bar while they are used."""
        bar = tqdm(items, desc=label, total=total, unit=f" {unit}", disable=None, leave=False)
        with self._compiling.counted_on(bar):
            yield from bar

    def saw(self, name: str, reading: "Reading", T_map_robot: "SE2") -> None:
        """Hand a placed reading on to the viewer."""
        if self._viewer is not None:
            self._viewer.saw(name, reading, T_map_robot)

    def finished(self, name: str, tbm_map: "TbmMap") -> None:
        """Hand a finished map on to the viewer."""
        if self._viewer is not None:
            self._viewer.finished(name, tbm_map)
