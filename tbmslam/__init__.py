"""One robot: laser scans and odometry become a map of belief masses.

The names below are the interface for notebooks. Each is loaded at its first use. `open_recording` is that of the
package `datasets`, which an installed wheel has as `tbmslam.datasets`.
"""

from typing import TYPE_CHECKING

from datasets import __name__ as _datasets
from tbmslam.lazy_names import lazy_names

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

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "SE2": ".geometry.se2",
        "LaserScan": ".sensing.laser_scan",
        "Reading": ".sensing.laser_scan",
        "RecordingOptions": f"{_datasets}.options",
        "Slam": ".slam",
        "SlamConfig": ".configuration.slam_config",
        "TbmGrid": ".belief.grid",
        "TbmMap": ".map.tbm_map",
        "TbmSlamError": ".errors",
        "load_map": ".io.map_folder",
        "open_recording": f"{_datasets}.opening",
        "preset": ".configuration.slam_config",
        "save_map": ".io.map_folder",
    },
)
