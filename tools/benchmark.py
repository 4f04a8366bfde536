"""Measure speed, memory and errors of mapping and merging.

`slam` maps recordings and simulated worlds with each preset, in a process each. `scaling` drives ever farther through a
simulated building and measures the cost of a scan. `align` aligns pairs of maps with known relative poses, and checks
the confidence. `merge` measures a merge by area, beside the paper's own program. `fleet` merges many maps of many
buildings. `split` cuts recordings into robots, maps and merges them, and compares the result with the whole recording.
`perturb` maps recordings with small changes, and measures how much the errors grow. `strangers` counts how often maps
of different places are merged. `limits` maps a recording of 24 hours and a building of 1 km2.
"""

if __name__ == "__main__":  # before anything else is loaded, since Ctrl-C may come at once
    from tools.command_line.interruption import handle_interruption

    handle_interruption("benchmark")

import argparse
import re
import sys
from importlib import import_module

from tools import benchmarks
from tools.build_maps import MOST_ROBOTS
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, ended, examples
from tools.merge import METHODS

PAIR_METHODS = (*METHODS, "howard")
"""Howard's method needs encounters of the robots, so `merge` does not offer it."""

EXAMPLES = """examples:
  python tools/%(prog)s.py slam intel.bag,angle_step_deg=1.0 mit-csail.bag --preset all
      two recordings, one with an option of build_maps; errors where .relations or .truth.tum lies beside
  python tools/%(prog)s.py slam --world office:1:good --world office:1:poor,beams=361 --repeat 3 --json figures.json
      bags of simulated drives (kind:seed:odometry and options of make_world), medians of three runs
  python tools/%(prog)s.py slam --world office:1:poor --world variety:1:ignored,beams=361 --seeds 10
      ten drives through ten buildings each, and a line on the worst of them
  python tools/%(prog)s.py align map-pairs/ --details --plot calibration.png
      every .npz pair of a folder (see datasets/synthetic/map_pairs/pairs.py), with a line for each wrong one
  python tools/%(prog)s.py align map-pairs/ --method all
      one table of our methods and the related work's
  python tools/%(prog)s.py split intel.bag,angle_step_deg=1.0 mit-csail.bag --robots 2,3
      each recording cut into robots, mapped, merged, and compared with the whole recording
  python tools/%(prog)s.py perturb mit-csail.bag --jobs 2 --without blocked_beams.enabled=false
      a recording with other angles, odometry, scans and mounts of the laser, and with another parameter
"""


def parser(program: str = "benchmark") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    epilog = examples(EXAMPLES, program)
    commands = grammar.add_subparsers(
        dest="command", required=True, metavar="slam|scaling|align|merge|fleet|split|perturb|strangers|limits"
    )
    for name, about, add in (
        ("slam", "speed, memory and errors on recordings and simulated worlds", _add_slam),
        ("scaling", "cost of a scan against the length of the drive and the size of map", _add_scaling),
        ("align", "how often pairs of maps are aligned correctly", _add_align),
        ("merge", "cost of a merge against the area of the maps, and of many robots", _add_merge),
        ("fleet", "cost and errors of merging many maps of many buildings", _add_fleet),
        ("split", "recordings cut into robots, mapped and merged again", _add_split),
        ("perturb", "how much errors grow when recordings are a little different", _add_perturb),
        ("strangers", "how often maps that do not belong together are merged", _add_strangers),
        ("limits", "whether a day of recording and 1 km2 of building fit into memory", _add_limits),
    ):
        command = commands.add_parser(name, help=about, epilog=epilog)
        add(command)
        more_of_json = "; strangers met there already are not tried again" if name == "strangers" else ""
        command.add_argument(
            "--json", type=path_argument, metavar="FILE", help=f"write all figures here too{more_of_json}"
        )
        command.add_argument(
            "--table", type=path_argument, metavar="FILE", help="write the tables here for docs/figures, see figures.py"
        )
        command.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _add_slam(slam: argparse.ArgumentParser) -> None:
    slam.add_argument("recordings", nargs="*", metavar="RECORDING[,option=value]...", help="bags or logs")
    slam.add_argument(
        "--world",
        action="append",
        default=[],
        metavar="KIND:SEED:ODOMETRY[,option=value]...",
        help="a simulated drive, e.g. office:1:good,beams=361; may be repeated. ODOMETRY: good, poor, none (without "
        "error) or ignored (the SLAM has none)",
    )
    slam.add_argument("--seeds", type=int, default=1, metavar="N", help="each world with SEED and the N - 1 next ones")
    slam.add_argument("--repeat", type=int, default=1, metavar="N", help="runs of each; the median is shown (1)")
    _add_preset(slam)


def _add_scaling(scaling: argparse.ArgumentParser) -> None:
    scaling.add_argument(
        "--lengths",
        default="125,250,500,1000",
        metavar="M,M,...",
        help="metres to drive (125,250,500,1000); 10000 reaches 1 km2 and takes long",
    )
    scaling.add_argument("--beams", type=int, default=180, help="beams of a scan (180)")
    _add_preset(scaling)


def _add_preset(command: argparse.ArgumentParser) -> None:
    command.add_argument("--preset", default="default", metavar="NAME,...", help="presets to run, or all (default)")


def _add_align(align: argparse.ArgumentParser) -> None:
    align.add_argument("pairs", type=path_argument, metavar="PAIRS_DIR", help="a folder of .npz pairs")
    align.add_argument(
        "--method",
        default="correlation",
        metavar="NAME,...",
        help=f"one or more of {', '.join(PAIR_METHODS)}, or all (correlation); howard is given a simulated encounter",
    )
    align.add_argument("--details", action="store_true", help="print a line for every pair that is not right")
    align.add_argument("--plot", type=path_argument, metavar="FILE", help="write a picture of the calibration here")


def _add_merge(merge: argparse.ArgumentParser) -> None:
    merge.add_argument(
        "--areas", default="4900,8100,12100,25600", metavar="M2,...", help="canvases (4900,8100,12100,25600)"
    )
    merge.add_argument("--resolution", type=float, default=0.05, metavar="M", help="cells of the alignment (0.05)")
    merge.add_argument("--robots", type=int, default=0, metavar="N", help="also merge the maps of N robots (0)")
    merge.add_argument("--workers", type=int, default=2, metavar="N", help="processes that align the robots' maps (2)")
    merge.add_argument("--repeat", type=int, default=5, metavar="N", help="runs of each step; the best is shown (5)")


def _add_split(split: argparse.ArgumentParser) -> None:
    split.add_argument("recordings", nargs="+", metavar="RECORDING[,option=value]...", help="bags or logs")
    split.add_argument(
        "--robots", default="2,3,5", metavar="N,...", help="numbers of robots that each is cut into (2,3,5)"
    )


def _add_perturb(perturb: argparse.ArgumentParser) -> None:
    perturb.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING[,option=value]...",
        help="bags or logs with .relations or .truth.tum beside them",
    )
    perturb.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="A.B=C",
        help="run also with this parameter, such as one that disables a rule; may be repeated",
    )
    perturb.add_argument("--jobs", type=int, default=1, metavar="N", help="runs at a time; the result is the same (1)")


def _add_strangers(strangers: argparse.ArgumentParser) -> None:
    strangers.add_argument("--pairs", type=int, default=400, metavar="N", help="pairs to try, a quarter a kind (400)")
    strangers.add_argument(
        "--sets", type=int, default=0, metavar="N", help="sets of six maps to try instead of pairs, a quarter a kind"
    )
    strangers.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the pairs (0)")
    strangers.add_argument("--workers", type=int, default=2, metavar="N", help="processes; the result is the same (2)")


def _add_fleet(fleet: argparse.ArgumentParser) -> None:
    fleet.add_argument(
        "sizes",
        nargs="*",
        default=["1x40", "40x1"],
        metavar="BUILDINGSxMAPS",
        help="number of buildings, and of maps of each (1x40 40x1)",
    )
    fleet.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the buildings (0)")
    fleet.add_argument("--workers", type=int, default=1, metavar="N", help="processes; the result is the same (1)")
    fleet.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler whose workers align the pairs")
    fleet.add_argument(
        "--plot", type=path_argument, metavar="FILE", help="write a picture of the first fleet's graph and map here"
    )


def _add_limits(limits: argparse.ArgumentParser) -> None:
    limits.add_argument(
        "--share", type=float, default=1.0, metavar="F", help="share of the full size: 0.1 is a quick test (1)"
    )


def main(argv: list[str] | None = None, program: str = "benchmark") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    try:
        _check(args)
    except ValueError as error:
        grammar.error(str(error))
    return ended(program, lambda: _run(args), debug=args.debug)


def _check(args: argparse.Namespace) -> None:
    """Parse and check the options."""
    if args.command == "align":
        args.method = _pair_methods(args.method)
    elif args.command == "merge":
        args.areas = _numbers("--areas", args.areas)
        if min(args.repeat, args.workers) < 1 or not 0 <= args.robots <= MOST_ROBOTS:
            raise ValueError(f"--repeat and --workers must be positive, --robots within 0 and {MOST_ROBOTS}")
        if not all(1.0 <= area <= 1e7 for area in args.areas) or not 1e-3 <= args.resolution <= 100.0:
            raise ValueError("--areas must lie within 1 and 1e7 m2, --resolution within 0.001 and 100 m")
    elif args.command == "fleet":
        _check_fleet(args)
    elif args.command == "split":
        _check_split(args)
    elif args.command == "perturb":
        _check_perturb(args)
    elif args.command == "limits":
        if not 1e-4 <= args.share <= 1.0:
            raise ValueError(f"--share must lie within 0.0001 and 1, got {args.share}")
    elif args.command == "strangers":
        _check_strangers(args)
    else:
        _check_drives(args)


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(f"{option} must be numbers with commas between, got {text!r}") from None


def _check_strangers(args: argparse.Namespace) -> None:
    """Check the options of `strangers`; see `_check`."""
    if min(args.pairs, args.workers) < 1 or min(args.seed, args.sets) < 0:
        raise ValueError("--pairs and --workers must be positive, --seed and --sets not negative")
    if args.sets and args.json:
        raise ValueError("--json keeps pairs, not --sets")


def _check_fleet(args: argparse.Namespace) -> None:
    """Parse and check the options of `fleet`; see `_check`."""
    if args.workers < 1 or args.seed < 0:
        raise ValueError("--workers must be positive, --seed not negative")
    args.sizes = [_fleet_size(text) for text in args.sizes]


def _fleet_size(text: str) -> tuple[int, int]:
    size = re.fullmatch(r"(\d{1,4})x(\d{1,4})", text)
    if size is None or not 2 <= int(size[1]) * int(size[2]) <= MOST_ROBOTS:
        raise ValueError(f"a fleet is BUILDINGSxMAPS, as 30x10, of 2 to {MOST_ROBOTS} maps, got {text!r}")
    return int(size[1]), int(size[2])


def _check_split(args: argparse.Namespace) -> None:
    """Parse and check the options of `split`; see `_check`."""
    from tools.benchmarks.recordings import parse_recording_spec

    counts = args.robots.split(",")
    if not all(count.isdecimal() and len(count) < 9 and 2 <= int(count) <= MOST_ROBOTS for count in counts):
        raise ValueError(f"--robots must be numbers within 2 and {MOST_ROBOTS}, as 2,3,5, got {args.robots}")
    args.robots = [int(count) for count in counts]
    for text in args.recordings:
        parse_recording_spec(text)


def _check_perturb(args: argparse.Namespace) -> None:
    """Parse and check the options of `perturb`; see `_check`."""
    from tools.benchmarks.recordings import parse_recording_spec

    if args.jobs < 1:
        raise ValueError(f"--jobs must be at least 1, got {args.jobs}")
    args.recordings = [parse_recording_spec(text) for text in args.recordings]


def _check_drives(args: argparse.Namespace) -> None:
    """Parse and check the options of `slam` and `scaling`; see `_check`."""
    from tbmslam.configuration.slam_config import PRESETS
    from tools.benchmarks.recordings import SimulatedRecording, parse_recording_spec

    args.preset = list(PRESETS) if args.preset == "all" else args.preset.split(",")
    for name in args.preset:
        if name not in PRESETS:
            raise ValueError(f"--preset: there is no {name!r}; there are {', '.join(PRESETS)}")
    if args.command == "scaling":
        args.lengths = _numbers("--lengths", args.lengths)
        if not all(1.0 <= length <= 1e7 for length in args.lengths) or args.beams < 1:
            raise ValueError("--lengths must lie within 1 and 1e7 m, --beams be positive")
        return
    args.recordings = [parse_recording_spec(text) for text in args.recordings]
    if not args.recordings and not args.world:
        raise ValueError("slam needs recordings or --world")
    args.world = [SimulatedRecording.parse(text) for text in args.world]
    for name in ("repeat", "seeds"):
        if getattr(args, name) < 1:
            raise ValueError(f"--{name} must be at least 1, got {getattr(args, name)}")


def _pair_methods(text: str) -> list[str]:
    names = list(PAIR_METHODS) if text == "all" else text.split(",")
    for name in names:
        if name not in PAIR_METHODS:
            raise ValueError(f"--method: there is no {name!r}; there are {', '.join(PAIR_METHODS)}, all")
    return names


_FUNCTIONS = {
    "slam": ("slam", "benchmark_slam"),
    "scaling": ("scaling", "benchmark_scaling"),
    "align": ("align", "benchmark_pairs"),
    "merge": ("merge", "benchmark_merge"),
    "fleet": ("fleet", "benchmark_fleet"),
    "split": ("split", "benchmark_split"),
    "perturb": ("perturb", "benchmark_perturbations"),
    "strangers": ("strangers", "benchmark_strangers"),
    "limits": ("scaling", "benchmark_limits"),
}
"""Module of `tools.benchmarks` and function of each command."""


def _run(args: argparse.Namespace) -> None:
    module, function = _FUNCTIONS[args.command]
    if args.command == "strangers" and args.sets:
        function = "benchmark_sets"
    getattr(import_module(f"{benchmarks.__name__}.{module}"), function)(args)


if __name__ == "__main__":
    sys.exit(main())
