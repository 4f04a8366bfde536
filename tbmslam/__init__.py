"""One robot: laser scans and odometry become a map of belief masses.

The names below are what a notebook needs; each is loaded when it is first used. `open_recording` is that of the package
`datasets`, which an installed wheel has as `tbmslam.datasets`.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets.opening import open_recording
    from datasets.options import RecordingOptions
    from tbmslam.config import SlamConfig, preset
    from tbmslam.errors import TbmSlamError
    from tbmslam.files.map_folder import load_map, save_map
    from tbmslam.grid import TbmGrid
    from tbmslam.laser_scan import LaserScan, Reading
    from tbmslam.se2 import SE2
    from tbmslam.slam import Slam
    from tbmslam.tbm_map import TbmMap

__all__ = [
    "SE2",
    "LaserScan",
    "Reading",
    "RecordingOptions",
    "Slam",
    "SlamConfig",
    "TbmGrid",
    "TbmMap",
    "TbmSlamError",
    "load_map",
    "open_recording",
    "preset",
    "save_map",
]

_HOMES = {
    "SE2": "se2",
    "LaserScan": "laser_scan",
    "Reading": "laser_scan",
    "Slam": "slam",
    "SlamConfig": "config",
    "TbmGrid": "grid",
    "TbmMap": "tbm_map",
    "TbmSlamError": "errors",
    "load_map": "files.map_folder",
    "preset": "config",
    "save_map": "files.map_folder",
}


def __getattr__(name: str) -> object:
    """Load a name when it is used: programs that want an error's class do not wait for compiled code."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"tbmslam.{_HOMES[name]}"), name)
    if name in ("open_recording", "RecordingOptions"):
        from datasets import RecordingOptions, open_recording  # noqa: PLC0415

        return {"open_recording": open_recording, "RecordingOptions": RecordingOptions}[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names for completion."""
    return sorted({*globals(), *__all__})
