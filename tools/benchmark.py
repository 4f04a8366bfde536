"""Measure speed, memory and errors of mapping and merging.

`slam` maps recordings and simulated worlds with one or more presets, each run in its own process. `scaling` measures
the cost of a scan on long simulated drives. `align` aligns pairs of maps with known relative poses, and checks the
confidence.
`merge` measures a merge by area, and compares it with the paper's program. `fleet` merges many maps of many buildings.
`split` cuts recordings into robots, maps and merges them, and compares the result with the whole recording. `perturb`
measures the errors of recordings with small changes. `strangers` counts false merges of maps of different places.
`limits` maps a recording of 24 hours and a building of 1 km2.
"""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from typing import Any

from tbmslam.errors import TbmSlamError
from tools import benchmarks
from tools.build_maps import MOST_ROBOTS
from tools.command_line.options import add_plot_option, check_plot, comma_separated, number_within
from tools.command_line.paths import check_exist, path_argument
from tools.command_line.program import ProgramParser, run_program
from tools.merge import METHODS

PAIR_METHODS = (*METHODS, "howard")
"""Howard's method needs encounters of the robots, so `merge` does not offer it."""

EXAMPLES = """examples:
  tbmslam benchmark slam intel.bag,angle_step_deg=1.0 mit-csail.bag --preset all
      two recordings, one with an option of `tbmslam map`; errors against .relations or .truth.tum beside them
  tbmslam benchmark slam --world office:1:good --world office:1:poor,beams=361 --repeat 3 --json figures.json
      simulated drives (kind:seed:odometry and options of `tbmslam world`), medians of three runs
  tbmslam benchmark slam --world office:1:poor --world variety:1:ignored,beams=361 --seeds 10
      a drive through each of ten buildings, and the worst of them
  tbmslam benchmark align map-pairs/ --details
      every .npz pair of a folder (as tools/make_map_pairs.py writes them), with a line for each wrong pair
  tbmslam benchmark align map-pairs/ --method all
      all methods in one table, with those of the related work
  tbmslam benchmark split intel.bag,angle_step_deg=1.0 mit-csail.bag --robots 2,3
      each recording cut into robots, mapped, merged, and compared with the whole recording
  tbmslam benchmark perturb mit-csail.bag --jobs 2 --without blocked_beams.enabled=false
      a recording with changed angles, odometry, scans and laser mounts, and with a changed parameter
"""


_COUNT, _SEED = number_within(int, 1), number_within(int, 0)


def parser(program: str = "benchmark") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    commands = grammar.add_subparsers(
        dest="command", required=True, metavar="slam|scaling|align|merge|fleet|split|perturb|strangers|limits"
    )
    for name, about, add, function in (
        ("slam", "speed, memory and errors on recordings and simulated worlds", _add_slam, "slam.benchmark_slam"),
        ("scaling", "cost of a scan by length of drive and area of map", _add_scaling, "scaling.benchmark_scaling"),
        ("align", "how often pairs of maps are aligned correctly", _add_align, "align.benchmark_pairs"),
        ("merge", "cost of a merge by area of the maps, and of many robots", _add_merge, "merge.benchmark_merge"),
        ("fleet", "cost and errors of merging many maps of many buildings", _add_fleet, "fleet.benchmark_fleet"),
        ("split", "recordings cut into robots, mapped and merged again", _add_split, "split.benchmark_split"),
        ("perturb", "errors of slightly changed recordings", _add_perturb, "perturb.benchmark_perturbations"),
        ("strangers", "how often maps of different places are merged", _add_strangers, "strangers.benchmark_strangers"),
        ("limits", "memory for a day of recording and for 1 km2 of building", _add_limits, "scaling.benchmark_limits"),
    ):
        command = commands.add_parser(name, help=about, epilog=EXAMPLES)
        command.set_defaults(function=function)
        add(command)
        command.add_argument("--json", type=path_argument, metavar="FILE", help="write all figures here too")
        command.add_argument(
            "--table", type=path_argument, metavar="FILE", help="write the tables here for docs/figures, see figures.py"
        )
        command.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _add_slam(slam: argparse.ArgumentParser) -> None:
    slam.add_argument(
        "recordings", nargs="*", type=_recording, metavar="RECORDING[,option=value]...", help="bags or logs"
    )
    slam.add_argument(
        "--world", type=_world, action="append", default=[], metavar="KIND:SEED:ODOMETRY[,option=value]...",
        help="a simulated drive, e.g. office:1:good,beams=361; may be repeated. ODOMETRY: good, poor, none (without "
        "error) or ignored (the SLAM has none)",
    )  # fmt: skip
    slam.add_argument(
        "--seeds", type=_COUNT, default=1, metavar="N", help="run each world with SEED and the next N - 1 seeds"
    )
    slam.add_argument("--repeat", type=_COUNT, default=1, metavar="N", help="runs of each; the median is shown (1)")
    _add_preset(slam)


def _add_scaling(scaling: argparse.ArgumentParser) -> None:
    scaling.add_argument(
        "--lengths", type=comma_separated(number_within(float, 1.0, 1e7)), default="125,250,500,1000", metavar="M,...",
        help="metres to drive (125,250,500,1000); 10000 reaches 1 km2 and takes long",
    )  # fmt: skip
    _add_preset(scaling)


def _add_preset(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--preset", type=_presets, default="default", metavar="NAME,...",
        help="presets to run, or all; without it the preset default",
    )  # fmt: skip


def _add_align(align: argparse.ArgumentParser) -> None:
    align.add_argument("pairs", type=path_argument, metavar="PAIRS_DIR", help="a folder of .npz pairs")
    align.add_argument(
        "--method", type=lambda text: _names(text, PAIR_METHODS), default="correlation", metavar="NAME,...",
        help=f"one or more of {', '.join(PAIR_METHODS)}, or all (correlation); howard is given a simulated encounter",
    )  # fmt: skip
    align.add_argument("--details", action="store_true", help="print a line for every pair that is not right")


def _add_merge(merge: argparse.ArgumentParser) -> None:
    merge.add_argument(
        "--areas", type=comma_separated(number_within(float, 1.0, 1e7)), default="4900,8100,12100,25600",
        metavar="M2,...", help="canvases (4900,8100,12100,25600)",
    )  # fmt: skip
    merge.add_argument("--repeat", type=_COUNT, default=5, metavar="N", help="runs of each step; best is shown (5)")


def _add_split(split: argparse.ArgumentParser) -> None:
    split.add_argument(
        "recordings", nargs="+", type=_recording, metavar="RECORDING[,option=value]...", help="bags or logs"
    )
    split.add_argument(
        "--robots", type=comma_separated(number_within(int, 2, MOST_ROBOTS)), default="2,3,5", metavar="N,...",
        help="numbers of robots that each is cut into (2,3,5)",
    )  # fmt: skip


def _add_perturb(perturb: argparse.ArgumentParser) -> None:
    perturb.add_argument(
        "recordings", nargs="+", type=_recording, metavar="RECORDING[,option=value]...",
        help="bags or logs with .relations or .truth.tum beside them",
    )  # fmt: skip
    perturb.add_argument(
        "--without", action="append", default=[], metavar="A.B=C",
        help="add a run with this changed parameter, e.g. with a rule disabled; may be repeated",
    )  # fmt: skip
    perturb.add_argument("--jobs", type=_COUNT, default=1, metavar="N", help="runs at a time; the result is equal (1)")


def _add_strangers(strangers: argparse.ArgumentParser) -> None:
    strangers.add_argument(
        "--pairs", type=_COUNT, default=400, metavar="N",
        help="pairs to try, a quarter of each kind; pairs in the file of --json are not tried again (400)",
    )  # fmt: skip
    strangers.add_argument(
        "--sets", type=_SEED, default=0, metavar="N", help="sets of six maps to try instead of pairs"
    )
    strangers.add_argument("--seed", type=_SEED, default=0, metavar="N", help="seed of the pairs (0)")
    strangers.add_argument("--workers", type=_COUNT, default=2, metavar="N", help="processes; the result is equal (2)")


def _add_fleet(fleet: argparse.ArgumentParser) -> None:
    fleet.add_argument(
        "sizes", nargs="*", type=_fleet_size, default=[(1, 40), (40, 1)], metavar="BUILDINGSxMAPS",
        help="number of buildings, and of maps of each (1x40 40x1)",
    )  # fmt: skip
    fleet.add_argument(
        "--seeds", type=comma_separated(_SEED), default="0", metavar="N,...",
        help="seeds of the buildings; each seed gives one fleet (0)",
    )  # fmt: skip
    fleet.add_argument("--workers", type=_COUNT, default=1, metavar="N", help="processes; the result is equal (1)")
    fleet.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler whose workers align the pairs")
    add_plot_option(fleet, "the first fleet")


def _add_limits(limits: argparse.ArgumentParser) -> None:
    limits.add_argument(
        "--share", type=number_within(float, 1e-4, 1.0), default=1.0, metavar="F", help="share of the full size (1)"
    )


def _parsed(parse: Callable[[str], Any], text: str) -> Any:
    """Return a parsed word; a ValueError becomes the message of the command line."""
    try:
        return parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _recording(text: str) -> object:
    from tools.benchmarks.recordings import parse_recording_spec

    return _parsed(parse_recording_spec, text)


def _world(text: str) -> object:
    from tools.benchmarks.recordings import SimulatedRecording

    return _parsed(SimulatedRecording.parse, text)


def _presets(text: str) -> list[str]:
    from tbmslam.configuration.slam_config import PRESETS

    return _names(text, tuple(PRESETS))


def _names(text: str, known: tuple[str, ...]) -> list[str]:
    """Return names with commas between; `all` stands for all known names."""
    names = [*known] if text == "all" else text.split(",")
    for name in names:
        if name not in known:
            raise argparse.ArgumentTypeError(f"there is no {name!r}; there are {', '.join(known)}, all")
    return names


def _fleet_size(text: str) -> tuple[int, int]:
    size = re.fullmatch(r"(\d{1,4})x(\d{1,4})", text)
    if size is None or not 2 <= int(size[1]) * int(size[2]) <= MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"must be BUILDINGSxMAPS, as 30x10, of 2 to {MOST_ROBOTS} maps, got {text!r}")
    return int(size[1]), int(size[2])


def main(argv: list[str] | None = None, program: str = "benchmark") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    if args.command == "slam" and not args.recordings and not args.world:
        grammar.error("slam needs recordings or --world")
    if args.command == "strangers" and args.sets:
        args.function = "stranger_sets.benchmark_sets"
    return run_program(program, lambda: _run(args), debug=args.debug)


def _run(args: argparse.Namespace) -> None:
    from tools.command_line.measurement_record import describe_machine

    check_plot(getattr(args, "plot", None))
    recordings = getattr(args, "recordings", ())
    check_exist(spec.path for spec in recordings)
    names = Counter(spec.name for spec in recordings)
    for name in (name for name, count in names.items() if count > 1):
        raise TbmSlamError(f"two recordings are named {name}: rename a file, or measure one at a time")
    args.machine = describe_machine()  # before the benchmark is itself its load
    module, function = args.function.split(".")
    getattr(import_module(f"{benchmarks.__name__}.{module}"), function)(args)


if __name__ == "__main__":
    sys.exit(main())
