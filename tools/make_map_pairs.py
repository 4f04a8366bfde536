"""Write pairs of partial maps of simulated or real buildings with their true relative pose, and pairs of two places."""

import argparse
import math
import re
import sys
from functools import partial
from pathlib import Path

from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import OVERLAPS, Building, building_of_area, building_of_world, room_of
from tbmslam.io.map_folder import load_map
from tools.command_line.options import number_within
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program
from tools.map_pairs.floors import floor_of_grid, pairs_of, variants_of
from tools.map_pairs.known_pair import PairFileError, load_pair

EXAMPLES = """examples:
  python tools/make_map_pairs.py -o pairs --seeds 0 1 2
      every kind of building with three seeds: six overlaps, two far ends, other buildings, a mirrored building
  python tools/make_map_pairs.py -o new-pairs --floor ex3=pairs/crop_ex3_100.npz csail=out/csail/mit-csail --parts 3
      parts of two real maps, of their mirror images, and of three parts of 30 to 250 m2 of each
  python tools/make_map_pairs.py -o bent --seeds 0 1 2 --bend 0.3 --overlap 100 50
      maps of different years: each is distorted by 0.3 m, and all movable objects are moved
"""
KINDS = ("office", "halls", "store", "corridor", "wings", "apartment", "open_plan")
_AREA, _SIZE, _PERCENT = number_within(float, 1, 1e5), number_within(float, 1e-6), number_within(int, 1, 100)
_SEED, _PARTS = number_within(int, 0), number_within(int, 0, 1000)
_MOST_BEND_M = 2.0  # largest deformation over 20 m [m]; beyond it the inverse is not exact to a cell


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    grammar = _parser()
    args = grammar.parse_args(argv)
    if not all(re.fullmatch(r"[\w.-]*\w=.+", floor) and "_" not in floor.partition("=")[0] for floor in args.floor):
        grammar.error(
            f"--floor must be NAME=PATH with a name of letters, digits, dots and dashes, got {' '.join(args.floor)}"
        )
    return run_program("make_map_pairs", lambda: _write(args), debug=args.debug)


def _parser() -> argparse.ArgumentParser:
    grammar = ProgramParser(prog="make_map_pairs", description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("-o", "--out", type=path_argument, required=True, metavar="FOLDER", help="where the pairs go")
    what = grammar.add_argument_group("buildings")
    what.add_argument("--world", nargs="+", choices=KINDS, help="kinds of simulated buildings (all; none with --floor)")
    what.add_argument("--seeds", nargs="+", type=_SEED, default=[0], metavar="N", help="seeds of these buildings (0)")
    what.add_argument(
        "--floor", nargs="+", default=[], metavar="NAME=PATH", help="real maps: the first map of a pair, or any map"
    )
    what.add_argument(
        "--lattice", type=_AREA, metavar="M2",
        help="also floors of this area with repeating blocks, one for each seed; only these without --world",
    )  # fmt: skip
    what.add_argument("--area", type=_AREA, metavar="M2", help="free area of the part of each building (all of it)")
    what.add_argument(
        "--parts", type=_PARTS, default=0, metavar="N", help="also pairs of the mirror image and of N parts"
    )
    what.add_argument(
        "--largest", type=_SIZE, default=math.inf, metavar="M2", help="leave out pairs with a larger known area"
    )
    what.add_argument("--overlap", nargs="+", type=_PERCENT, metavar="PERCENT", help="overlaps of the maps (100 to 15)")
    grammar.add_argument(
        "--bend", type=number_within(float, 1e-6, _MOST_BEND_M), metavar="M",
        help="distort each map by this over tens of metres, and move all objects (2 to 6 cm, and some objects)",
    )  # fmt: skip
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _write(args: argparse.Namespace) -> None:
    kinds = args.world or (() if args.floor or args.lattice else KINDS)
    buildings = [building_of_world(kind, seed) for seed in args.seeds for kind in kinds]
    if args.lattice:
        buildings += [building_of_area(args.lattice, seed) for seed in args.seeds]
    buildings += [_floor(*floor.split("=", 1)) for floor in args.floor]
    if args.area is not None:
        buildings = [room_of(building, args.area, 1) for building in buildings]
    if args.parts:
        buildings = [variant for building in buildings for variant in variants_of(building, args.parts)]
    count = 0
    overlaps = OVERLAPS if args.overlap is None else [percent / 100.0 for percent in args.overlap]
    draw = Distortion.draw if args.bend is None else partial(Distortion.of_another_time, deformation_m=args.bend)
    for pair in pairs_of(buildings, 1, overlaps, draw):
        if pair.known_m2 <= args.largest:
            pair.save(args.out)
            count += 1
    print(f"{count} pairs in {args.out}")


def _floor(name: str, path: str) -> Building:
    try:
        return floor_of_grid(name, load_pair(Path(path)).target.grid)
    except PairFileError:
        return floor_of_grid(name, load_map(path).grid)


if __name__ == "__main__":
    sys.exit(main())
