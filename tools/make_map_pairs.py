"""Write pairs of partial maps of made-up buildings, with their true relative pose, and pairs that show two places."""

import argparse
import sys
from pathlib import Path

EXAMPLES = """examples:
  python tools/%(prog)s.py -o pairs --seeds 0 1 2
      every kind of building with three seeds each: six overlaps, two far ends, other buildings, a mirrored one
  python tools/%(prog)s.py -o small --world office apartment --seeds 0 1 --area 60
      parts of offices and apartments of about 60 m2

exit codes: 0 done, 1 a file cannot be written (one line says why), 2 wrong usage
"""
KINDS = ("office", "halls", "store", "corridor", "wings", "apartment", "open_plan")


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    grammar = argparse.ArgumentParser(
        prog="make_map_pairs", description=__doc__, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    grammar.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER", help="where the pairs go")
    grammar.add_argument("--world", nargs="+", choices=KINDS, default=KINDS, help="kinds of buildings (all)")
    grammar.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="N", help="of the buildings (0)")
    grammar.add_argument("--area", type=float, metavar="M2", help="take only so much of each building (all of it)")
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    args = grammar.parse_args(argv)
    if args.area is not None and not args.area > 0.0:
        grammar.error(f"--area must be positive, got {args.area}")
    from tbmslam.errors import TbmSlamError

    try:
        count = _write(args)
    except TbmSlamError as error:
        if args.debug:
            raise
        sys.stderr.write(f"make_map_pairs: {error}\n")
        return 1
    print(f"{count} pairs in {args.out}")
    return 0


def _write(args: argparse.Namespace) -> int:
    from datasets.synthetic.map_pairs import (
        building_of_world,
        cut_pairs,
        disjoint_pair,
        foreign_pair,
        mirrored,
        room_of,
    )

    buildings = [building_of_world(kind, seed) for seed in args.seeds for kind in args.world]
    if args.area is not None:
        buildings = [room_of(building, args.area, 1) for building in buildings]
    count = 0
    for index, building in enumerate(buildings):
        others = [buildings[(index + step) % len(buildings)] for step in (1, 2)]
        foreign = [foreign_pair(building, other, 1) for other in others if other is not building]
        pairs = [*cut_pairs(building, 1), disjoint_pair(building, 1), *foreign]
        for pair in [*pairs, foreign_pair(building, mirrored(building), 1)]:
            pair.save(args.out)
            count += 1
    return count


if __name__ == "__main__":
    sys.exit(main())
