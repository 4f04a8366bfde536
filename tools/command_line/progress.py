"""Progress on the terminal, how far, how fast, and how long it will take; and in a viewer where one is wanted."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, TypeVar

from tqdm import tqdm

from tbmslam.parallel.progress import Watch
from tools.command_line.compiling import tell_of_compiling

if TYPE_CHECKING:
    from tbmslam.geometry.se2 import SE2
    from tbmslam.map.tbm_map import TbmMap
    from tbmslam.report.rerun_viewer import RerunViewer
    from tbmslam.sensing.laser_scan import Reading

T = TypeVar("T")


class ProgressBars(Watch):
    """Shows a bar with rate and time left for every step of many items; nothing where the output is no terminal.

    Parameters
    ----------
    viewer
        Who shows the mapping itself.
    """

    def __init__(self, viewer: "RerunViewer | None" = None) -> None:
        super().__init__()
        self._compiling = tell_of_compiling()
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
