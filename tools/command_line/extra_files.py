"""Optional files beside a map: a GeoTIFF, bags with an occupancy grid, and the files of an edit."""

import argparse
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datasets.rosbag.occupancy import Format
    from tbmslam.map.tbm_map import TbmMap

logger = logging.getLogger(__name__)

_GEOTIFF = "map.tif"
_BAGS: "Mapping[Format, str]" = {"ros1": "map.bag", "mcap": "map.mcap"}
EXTRA_FILES = (_GEOTIFF, *_BAGS.values())
"""Names of the optional files beside a map."""
EDIT_FILES = ("edits.toml", "keepout.yaml", "keepout.pgm")
"""Files of an edited map besides the map."""


def add_extra_files(grammar: argparse.ArgumentParser) -> None:
    """Add the options for optional files."""
    files = grammar.add_argument_group("further files beside each map")
    files.add_argument(
        "--geotiff", action="store_true", help="map.tif for QGIS and others (needs the extra tbmslam[geotiff])"
    )
    files.add_argument(
        "--occupancy-bag",
        nargs="?",
        const="ros1",
        choices=tuple(_BAGS),
        help="a bag with the map as nav_msgs/OccupancyGrid on /map: map.bag of ROS 1 (default) or map.mcap of ROS 2",
    )


def check_extra_files(options: argparse.Namespace) -> None:
    """Check that the requested files can be written."""
    if options.geotiff:
        from tbmslam.io.geotiff import require_rasterio

        require_rasterio()


def write_extra_files(folder: Path, tbm_map: "TbmMap | None", options: argparse.Namespace) -> None:
    """Write the requested files, and rewrite those of an earlier run so that all show the same map.

    Without a map, files of an earlier run are removed. An earlier GeoTIFF is also removed if rasterio is not installed.
    """
    if tbm_map is None:
        for name in EXTRA_FILES:
            (folder / name).unlink(missing_ok=True)
        return
    geotiff, bags = folder / _GEOTIFF, {kind: folder / name for kind, name in _BAGS.items()}
    if options.geotiff or geotiff.exists():
        from tbmslam.io.geotiff import GeoTiffError, write_geotiff

        try:
            write_geotiff(geotiff, tbm_map.grid)
        except GeoTiffError as error:
            if options.geotiff:
                raise
            logger.warning("%s shows an older map and was removed: %s", geotiff, error)
            geotiff.unlink()
    wanted = [kind for kind, path in bags.items() if kind == options.occupancy_bag or path.exists()]
    if wanted:
        from datasets.rosbag.occupancy import write_occupancy_bag

        stamps = [float(drive.trajectory.stamps.max()) for drive in tbm_map.drives if len(drive.trajectory)]
        for kind in wanted:
            write_occupancy_bag(bags[kind], tbm_map.grid, max(stamps, default=0.0), kind)
