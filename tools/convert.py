"""Convert a map from one format to another.

The name of the output chooses the format. Beliefs survive in map folders, .npz and .tif; other formats hold less.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tbmslam.errors import TbmSlamError
from tools.command_line.paths import check_exist, holds_map, path_argument, refuse_to_overwrite
from tools.command_line.program import ProgramParser, run_program

if TYPE_CHECKING:
    from tbmslam.map.tbm_map import TbmMap

EXAMPLES = """examples:
  tbmslam convert out/one/run map.yaml
      for ROS map_server and nav2: map.yaml and map.pgm
  tbmslam convert plan.png out/plan --resolution 0.05 --origin -10 -5
      a floor plan as a map folder: white is free, black occupied, grey 205 unknown
  tbmslam convert out/one/run graph.g2o
      keyframes, measured motions and loop closures, for g2o and GTSAM

formats:
  a name without ending  map folder
  .npz        beliefs, drives and keyframes
  .yaml .yml  ROS map with its picture
  .png        picture of a ROS map with a world file (.pgw; an input without a world file needs --resolution)
  .tif .tiff  GeoTIFF with beliefs (needs the extra tbmslam[geotiff])
  .bag .mcap  nav_msgs/OccupancyGrid, out on /map
  .tbm_map    dump of the original programs
  .g2o        pose graph, only out
  .dat .pgm   Beesoft map, picture (with --resolution), only in
"""
_WRITTEN = ("", ".npz", ".yaml", ".yml", ".png", ".tif", ".tiff", ".bag", ".mcap", ".tbm_map", ".g2o")
_PICTURES = (".png", ".pgm", ".bmp", ".jpg", ".jpeg")


def parser(program: str = "convert") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("map", type=path_argument, metavar="MAP", help="folder or file of a map")
    grammar.add_argument("out", type=path_argument, metavar="OUT", help="folder or file to write")
    picture = grammar.add_argument_group("place of a picture")
    picture.add_argument("--resolution", type=float, metavar="M", help="side of a pixel [m]")
    picture.add_argument(
        "--origin", type=float, nargs=2, metavar=("X", "Y"), help="lower left corner of the picture [m] (0 0)"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def main(argv: list[str] | None = None, program: str = "convert") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    args = parser(program).parse_args(argv)
    return run_program(program, lambda: _run(args), debug=args.debug)


def _run(args: argparse.Namespace) -> None:
    check_exist([args.map], "does not exist: give a map's folder or file")
    ending = _format_of(args.out)
    refuse_to_overwrite(_files_read(args.map), _files_written(args.out, ending))
    if not ending:
        from tools.command_line.other_results import refuse_other_results

        refuse_other_results(args.out, of_merge=False)
    tbm_map = _read(args.map, args.resolution, args.origin and tuple(args.origin))
    _write(args.out, ending, tbm_map)
    print(f"{args.map}: {tbm_map.grid.summary()} -> {args.out}")


def _read(path: Path, resolution: float | None, origin: tuple[float, float] | None) -> "TbmMap":
    from tbmslam.io.map_folder import load_map
    from tbmslam.map.tbm_map import TbmMap

    ending = path.suffix.lower()
    if ending in _PICTURES and not path.is_dir():
        return _read_picture(path, resolution, origin)
    if resolution is not None or origin is not None:
        raise TbmSlamError(f"{path}: is not a picture and states its cells: drop --resolution and --origin")
    if ending == ".g2o":
        raise TbmSlamError(f"{path}: is only written, not read: give a map's folder or file")
    if ending in (".tif", ".tiff"):
        from tbmslam.io.geotiff import read_geotiff

        return TbmMap(read_geotiff(path), provenance={"read_from": path.name})
    if ending in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file():
        from datasets.rosbag.occupancy import read_occupancy_bag

        return TbmMap(read_occupancy_bag(path), provenance={"read_from": path.name})
    return load_map(path)


def _read_picture(path: Path, resolution: float | None, origin: tuple[float, float] | None) -> "TbmMap":
    """Return the map of a picture, whose place is stated by options or else by a world file beside it."""
    from tbmslam.io.pictures import read_world_file
    from tbmslam.map.map_image import read_image
    from tbmslam.map.tbm_map import TbmMap

    world_file = path.with_suffix(".pgw")
    if resolution is None and not world_file.is_file():
        raise TbmSlamError(f"{path}: a picture holds no size of its pixels: pass --resolution")
    if resolution is None and origin is not None:
        raise TbmSlamError(f"{path}: its world file states the origin: drop --origin, or pass --resolution")
    if resolution is None:
        geometry = read_world_file(world_file, *read_image(path).pixels.shape[:2])
        resolution, origin = geometry.resolution, (geometry.origin_x, geometry.origin_y)
    return TbmMap.from_image(path, resolution, origin or (0.0, 0.0))


def _format_of(out: Path) -> str:
    """Return the suffix that chooses the format of an output; empty for a folder."""
    ending = "" if out.is_dir() else out.suffix.lower()
    if ending not in _WRITTEN:
        raise TbmSlamError(f"{out}: no format has the suffix {ending}: choose of {', '.join(filter(None, _WRITTEN))}")
    return ending


def _files_read(path: Path) -> list[Path]:
    from tbmslam.io.map_folder import files_of_map

    if path.is_dir():
        return files_of_map(path) if holds_map(path) else [path]
    return [*files_of_map(path), path.with_suffix(".pgw")]


def _files_written(out: Path, ending: str) -> list[Path]:
    from tbmslam.io.map_folder import FIXED_NAMES

    if not ending:
        return [out, *(out / name for name in (*FIXED_NAMES, *_replaced_names()))]
    beside = {".yaml": ".pgm", ".yml": ".pgm", ".png": ".pgw"}.get(ending, ending)
    return [out, out.with_suffix(beside)]


def _replaced_names() -> tuple[str, ...]:
    """Return the names of files besides the map that contradict a new map in their folder."""
    from tools.command_line.extra_files import EDIT_FILES, EXTRA_FILES

    return (*EXTRA_FILES, *EDIT_FILES)


def _write(out: Path, ending: str, tbm_map: "TbmMap") -> None:
    """Write a map in the format of a suffix."""
    from datasets.rosbag.occupancy import write_occupancy_bag
    from tbmslam.io.atomic_file import write_bytes
    from tbmslam.io.geotiff import write_geotiff
    from tbmslam.io.map_folder import save_map
    from tbmslam.io.map_npz import write_map_file
    from tbmslam.io.pictures import encode_png, write_world_file
    from tbmslam.io.ros_map import ros_pixels, write_ros_map
    from tbmslam.io.tbm_dump import write_tbm_dump
    from tbmslam.io.trajectory_file import write_g2o
    from tools.command_line.checksums import write_checksums
    from tools.command_line.output_folder import output_folder

    if ending == "":
        with output_folder(out):
            save_map(out, tbm_map)
            for name in _replaced_names():
                (out / name).unlink(missing_ok=True)
            write_checksums(out)
    elif ending == ".npz":
        write_map_file(out, tbm_map)
    elif ending in (".yaml", ".yml"):
        write_ros_map(out, tbm_map.grid)
    elif ending == ".png":
        write_bytes(out, encode_png(ros_pixels(tbm_map.grid)))  # greys of a pignistic picture read as unknown
        write_world_file(out, tbm_map.grid.geometry)
    elif ending in (".tif", ".tiff"):
        write_geotiff(out, tbm_map.grid)
    elif ending in (".bag", ".mcap"):
        stamps = [float(drive.trajectory.stamps.max()) for drive in tbm_map.drives if len(drive.trajectory)]
        write_occupancy_bag(out, tbm_map.grid, max(stamps, default=0.0), "mcap" if ending == ".mcap" else "ros1")
    elif ending == ".tbm_map":
        write_tbm_dump(out, tbm_map.grid)
    elif any(len(drive.keyframes) for drive in tbm_map.drives):
        write_g2o(out, tbm_map.drives, tbm_map.links)
    else:
        raise TbmSlamError(f"{out}: the map has no keyframes to write: give a map that `tbmslam map` or `merge` wrote")


if __name__ == "__main__":
    sys.exit(main())
