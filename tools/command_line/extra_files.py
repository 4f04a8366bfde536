"""Files beside a map that some people's tools want, and most do not."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbmslam.map.tbm_map import TbmMap

_BAGS = {"ros1": "map.bag", "mcap": "map.mcap"}


def add_extra_files(grammar: argparse.ArgumentParser) -> None:
    """Add the options that ask for them."""
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
    """Check that what was asked for can be written.

    Raises
    ------
    TbmSlamError
        If what writes it is not installed.
    """
    if options.geotiff:
        from tbmslam.io.geotiff import require_rasterio

        require_rasterio()


def write_extra_files(folder: Path, tbm_map: "TbmMap | None", options: argparse.Namespace) -> None:
    """Write what was asked for; what was not, and any when there is no map, is removed as part of an older map.

    Raises
    ------
    TbmSlamError
        If a file cannot be written, or what writes it is not installed.
    """
    if options.geotiff and tbm_map is not None:
        from tbmslam.io.geotiff import write_geotiff

        write_geotiff(folder / "map.tif", tbm_map.grid)
    else:
        (folder / "map.tif").unlink(missing_ok=True)
    for kind, name in _BAGS.items():
        if options.occupancy_bag != kind or tbm_map is None:
            (folder / name).unlink(missing_ok=True)
    if options.occupancy_bag is not None and tbm_map is not None:
        from datasets.rosbag.occupancy import write_occupancy_bag

        stamps = [float(drive.trajectory.stamps.max()) for drive in tbm_map.drives if len(drive.trajectory)]
        path = folder / _BAGS[options.occupancy_bag]
        write_occupancy_bag(path, tbm_map.grid, max(stamps, default=0.0), options.occupancy_bag)
