"""One robot: laser scans and odometry become a map of belief masses.

The names below are the interface for notebooks. Each is loaded at its first use. `open_recording` is that of the
package `datasets`, which an installed wheel has as `tbmslam.datasets`.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets.opening import open_recording
    from datasets.options import RecordingOptions
    from tbmslam.belief.grid import TbmGrid
    from tbmslam.configuration.slam_config import SlamConfig, preset
    from tbmslam.errors import TbmSlamError
    from tbmslam.geometry.se2 import SE2
    from tbmslam.io.map_folder import load_map, save_map
    from tbmslam.map.tbm_map import TbmMap
    from tbmslam.sensing.laser_scan import LaserScan, Reading
    from tbmslam.slam import Slam

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
    "SE2": "geometry.se2",
    "LaserScan": "sensing.laser_scan",
    "Reading": "sensing.laser_scan",
    "Slam": "slam",
    "SlamConfig": "configuration.slam_config",
    "TbmGrid": "belief.grid",
    "TbmMap": "map.tbm_map",
    "TbmSlamError": "errors",
    "load_map": "io.map_folder",
    "preset": "configuration.slam_config",
    "save_map": "io.map_folder",
}


def __getattr__(name: str) -> object:
    """Load a name at its first use, so that programs that need only an error's class do not load compiled code."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"tbmslam.{_HOMES[name]}"), name)
    if name in ("open_recording", "RecordingOptions"):
        from datasets import RecordingOptions, open_recording  # noqa: PLC0415

        return {"open_recording": open_recording, "RecordingOptions": RecordingOptions}[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names for completion."""
    return sorted({*globals(), *__all__})
