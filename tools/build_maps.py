"""Turn recordings into one belief map per robot.

A recording may be split into segments that stand for several robots. Each robot is mapped separately, and its map has
its own frame.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if not __package__:  # run as a file of a clone, whose packages may not be installed under these names
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tools.command_line.extra_files import add_extra_files
from tools.command_line.options import (
    add_configuration_options,
    add_recording_options,
    add_viewer_option,
    given_options,
    number_within,
    options_from,
)
from tools.command_line.paths import check_exist, path_argument
from tools.command_line.program import ProgramParser, loading, run_program

if TYPE_CHECKING:
    from tools.command_line.configuration import Configuration

EXAMPLES = """examples:
  tbmslam map recording.bag --robots 3 --overlap 0.3 -o out/building
      split one drive into three robots that share 30 percent of their path
  tbmslam map monday.bag tuesday.bag --separate --profile stata -o out/stata
      a robot for each bag, with the topics and frames of the MIT Stata Center recordings
  tbmslam map recordings/ --separate --workers 8 --config mine.toml -o out/all
      every recording of a directory, eight at a time, with changed parameters; a second run continues the first

exit codes: 0 done, 1 error, described in one line (finished robots are kept), 2 wrong usage, 130 interrupted,
143 terminated
"""

MOST_ROBOTS = 10_000


def parser(program: str = "build_maps") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument(
        "recordings", nargs="*", type=path_argument, metavar="RECORDING", help="bags, logs, or directories of them"
    )
    grammar.add_argument(
        "-o", "--out", type=path_argument, default=Path("maps"), help="folder of the robots' folders (maps)"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    _add_robots(grammar.add_argument_group("robots"))
    add_configuration_options(grammar, "map.resolution=0.1")
    many = grammar.add_argument_group("many recordings, many machines")
    many.add_argument(
        "--workers", type=number_within(int, 1), default=1, metavar="N", help="processes that map robots (1)"
    )
    many.add_argument(
        "--scheduler", metavar="ADDRESS", help="map on an existing Dask cluster, e.g. tcp://10.0.0.1:8786"
    )
    many.add_argument("--redo", action="store_true", help="map finished robots again")
    add_extra_files(grammar)
    add_viewer_option(grammar)
    truth = grammar.add_argument_group("truth, for evaluation only")
    truth.add_argument(
        "--reference", type=path_argument, nargs="+", metavar="TUM",
        help="true trajectory of each recording, in one frame; else the map of the whole drive is the reference",
    )  # fmt: skip
    truth.add_argument("--no-truth", action="store_true", help="write no truth.json")
    add_recording_options(grammar)
    return grammar


def _add_robots(robots: argparse._ArgumentGroup) -> None:
    robots.add_argument(
        "--separate", action="store_true", help="recordings are separate drives; else all recordings are one drive"
    )
    robots.add_argument(
        "--robots", type=number_within(int, 1, MOST_ROBOTS), default=1, metavar="N",
        help="split the drive into N robots (1)",
    )  # fmt: skip
    robots.add_argument(
        "--split",
        choices=("distance", "time", "gaps"),
        default="distance",
        help="split by distance, by time, or at gaps (see --gap), default: distance",
    )
    robots.add_argument(
        "--overlap", type=float, default=0.3, metavar="F", help="common share of neighbours' paths (0.3)"
    )
    robots.add_argument(
        "--interval", nargs=2, type=float, action="append", metavar=("BEGIN", "END"),
        help="interval of a robot, in seconds since the start; repeat for more robots",
    )  # fmt: skip
    robots.add_argument(
        "--frames", choices=("private", "odometry"), default="private",
        help="private: a random frame for each robot; odometry: the odometry frame (private)",
    )  # fmt: skip
    robots.add_argument(
        "--seed", type=number_within(int, 0),
        help="seed of the private frames and of random matchers (the configuration's)",
    )  # fmt: skip


def main(argv: list[str] | None = None, program: str = "build_maps") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    _check_usage(grammar, args)
    return run_program(
        program,
        lambda: _run(grammar, args, argv, program),
        debug=args.debug,
        interrupted="run the same command again to continue; finished robots are kept",
        out_of_memory="use a coarser map.resolution, a smaller map.max_cells or fewer --workers",
    )


def _run(grammar: argparse.ArgumentParser, args: argparse.Namespace, argv: list[str] | None, program: str) -> None:
    check_exist([*args.recordings, args.config, *(args.reference or ())])
    with loading():
        from tools.command_line.configuration import whole_text
        from tools.command_line.program import typed_command
        from tools.mapping.run import build_maps

    _check_recording_options(grammar, args)
    config = _configuration(args)
    if args.print_config:
        print(whole_text(config), end="")
    else:
        build_maps(args, config, typed_command(program, argv))


def _check_usage(grammar: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    if not args.recordings and not args.print_config:
        grammar.error("the following arguments are required: RECORDING: give a bag, a log or a directory of them")
    # The number of recordings in a directory is not known yet. (os.path does not fail if a name is too long.)
    listed = args.separate and any(os.path.isdir(path) for path in args.recordings)  # noqa: PTH112
    if args.reference and not listed and len(args.reference) != (len(args.recordings) if args.separate else 1):
        grammar.error("--reference needs one trajectory for each recording (one in all without --separate)")
    if args.separate and (args.robots != 1 or args.interval):
        grammar.error("--robots and --interval cut one drive: drop them or --separate")
    if not 0.0 <= args.overlap < 1.0:
        grammar.error(f"--overlap must be at least 0 and below 1, got {args.overlap:g}")
    if args.scheduler and args.workers > 1:
        grammar.error("a --scheduler has its own workers: drop --workers")


def _check_recording_options(grammar: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    try:
        options_from(args)
    except ValueError as error:
        grammar.error(str(error))


def _configuration(args: argparse.Namespace) -> "Configuration":
    """Return the configuration by preset, file, settings and options, in increasing priority."""
    from tbmslam.configuration.parameters import changed
    from tools.command_line.configuration import read_configuration

    config = read_configuration(args.preset, args.config).with_settings(args.set)
    changes: dict[str, object] = {"recording": given_options(args)}
    if args.no_return is not None:
        changes["map"] = {"insertion": {"no_return": "free" if args.no_return == "free" else "ignore"}}
    if args.seed is not None:
        changes["seed"] = args.seed
    return changed(config, changes, "command line")


if __name__ == "__main__":
    sys.exit(main())
