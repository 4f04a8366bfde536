"""Repeat the paper's experiments on maps with known relative poses, and write a report.

The report contains every table and figure of M. Dobrokhvalov, A. Filatov, "Merging occupancy grid map based on
Transferable Belief Model", SEIM 2021, with the paper's values beside the measured values. The output folder receives
report.html, figures.json, and the recordings and maps unless they are given.
"""

import argparse
import sys
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from tools import paper
from tools.command_line.options import comma_separated, number_within
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program, say, typed_command
from tools.make_world import WORLDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.paper.experiments import PaperResults, PaperSettings
    from tools.paper.map_pair import MapPair

EXAMPLES = """examples:
  python tools/reproduce_paper.py -o out/paper
      five simulated drives through one office, mapped as the paper's were: ten pairs
  python tools/reproduce_paper.py run.bag --robots 5 --overlap 0.8 -o out/paper-run
      a recording, cut into five robots; the reference is the map of the whole recording by the default SLAM
  python tools/reproduce_paper.py --maps out/paper/maps --tolerance 0.3 -o out/paper-strict
      existing maps (a folder that `tbmslam map` wrote, with its truth.json)
"""
_MAPPING = ("--preset", "viny", "--set", "map.resolution=0.1")
"""Options of the mapping, as in the paper."""

_PLURAL, _PAIRS = number_within(int, 2, 1000), number_within(int, 1, 16)
_OVERLAP, _POSITIVE = number_within(float, 0, 0.9), number_within(float, 1e-6, 1e6)
_COUNTS, _NUMBERS = comma_separated(number_within(int, 1)), comma_separated(_POSITIVE)


def parser() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog="reproduce_paper", description=__doc__, epilog=EXAMPLES)
    grammar.add_argument(
        "recordings", nargs="*", type=path_argument, help="bags or logs of one drive; none: simulated drives"
    )
    grammar.add_argument(
        "-o", "--out", type=path_argument, required=True, help="folder for all results; created if missing"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    maps = grammar.add_argument_group("maps")
    maps.add_argument("--maps", type=path_argument, metavar="DIR", help="use maps that `tbmslam map` wrote")
    maps.add_argument("--world", choices=WORLDS, default="office", help="kind of the simulated building (office)")
    maps.add_argument("--seed", type=number_within(int, 0), default=1, help="seed of the building and the drives (1)")
    maps.add_argument("--drives", type=_PLURAL, default=5, metavar="N", help="number of simulated drives (5)")
    maps.add_argument("--duration", type=_POSITIVE, metavar="S", help="longest duration of a simulated drive")
    maps.add_argument("--robots", type=_PLURAL, default=5, metavar="N", help="robots that recordings are cut into (5)")
    maps.add_argument(
        "--overlap", type=_OVERLAP, default=0.8, metavar="F", help="common share of two robots' paths (0.8)"
    )
    paper = grammar.add_argument_group("experiments")
    paper.add_argument("--pairs", type=_PAIRS, default=10, metavar="N", help="largest number of pairs, to 16 (10)")
    paper.add_argument(
        "--tolerance", type=_POSITIVE, default=0.5, metavar="M", help="largest error of a right match (0.5)"
    )
    paper.add_argument("--keypoints", type=_COUNTS, default="100,500,1000,2500,5000", help="keypoints in table II")
    paper.add_argument("--ratios", type=_NUMBERS, default="0.5,0.6,0.7,0.8", help="ratios in table II")
    paper.add_argument("--areas", type=_areas, default="4125,4900,5625,8700,12100,13200", help="areas in table IV [m2]")
    paper.add_argument("--repeat", type=_PLURAL, default=10, metavar="N", help="timed runs of each pair (10)")
    return grammar


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    grammar = parser()
    args = grammar.parse_args(argv)
    if args.maps is not None and args.recordings:
        grammar.error("--maps replaces recordings: give one of them")
    command = typed_command("reproduce_paper", argv)
    return run_program("reproduce_paper", lambda: _reproduce(args, command), debug=args.debug)


def _areas(text: str) -> list[float]:
    return _NUMBERS(text) if text else []


def _reproduce(args: argparse.Namespace, command: str) -> None:
    import json

    from tbmslam.io.atomic_file import write_text
    from tools.paper.experiments import load_pairs, record_of, run_experiments

    args.out.mkdir(parents=True, exist_ok=True)
    pairs = load_pairs(args.maps or _make_maps(args), args.pairs)
    settings = _settings(args)
    results = run_experiments(pairs, settings, _say)
    write_text(args.out / "figures.json", json.dumps(record_of(results, settings, command), indent=2) + "\n")
    write_text(args.out / "report.html", _report(args, command, pairs, settings, results))
    print(f"report -> {args.out / 'report.html'}")


def _make_maps(args: argparse.Namespace) -> Path:
    from tools.paper.experiments import map_recordings, map_simulated, simulate_recordings

    if args.recordings:
        cut = ["--robots", str(args.robots), "--overlap", str(args.overlap)]
        return map_recordings(args.recordings, args.out / "maps", [*_MAPPING, *cut])
    _say("simulating drives")
    world = ["--world", args.world, "--odometry", "good", "--rate", "5"]
    world += [] if args.duration is None else ["--duration", str(args.duration)]
    bags = simulate_recordings(args.out / "bags", world, args.drives, args.seed)
    _say("mapping")
    return map_simulated(bags, args.out / "maps", _MAPPING)


def _settings(args: argparse.Namespace) -> "PaperSettings":
    from tools.paper.experiments import PaperSettings

    default_keypoints = 1000 if 1000 in args.keypoints else args.keypoints[0]
    default_ratio = 0.7 if 0.7 in args.ratios else args.ratios[0]
    return PaperSettings(
        keypoints=tuple(args.keypoints),
        ratios=tuple(args.ratios),
        default_keypoints=default_keypoints,
        default_ratio=default_ratio,
        tolerance_m=args.tolerance,
        areas_m2=tuple(args.areas),
        repeats=args.repeat,
    )


def _report(
    args: argparse.Namespace,
    command: str,
    pairs: "Sequence[MapPair]",
    settings: "PaperSettings",
    results: "PaperResults",
) -> str:
    from tbmslam.report.page import Table, render
    from tools.command_line.measurement_record import describe_machine
    from tools.paper.figures import pictures_of
    from tools.paper.map_pair import SHARE
    from tools.paper.tables import values_of

    made = "recordings that were given" if args.recordings else f"simulated drives through one building ({args.world})"
    parameters = {**vars(settings), **{key: str(value) for key, value in sorted(vars(args).items())}}
    rows = [[key, str(value)] for key, value in {**parameters, **describe_machine()}.items()]
    return render(
        resources.files(paper).joinpath("report.html").read_text(encoding="utf-8"),
        pairs=pairs,
        results=results,
        settings=settings,
        command=command,
        share=SHARE,
        source=f"maps from {args.maps}" if args.maps else f"maps of {made}, made by the preset viny",
        truth_is_exact=not (args.recordings or args.maps),
        settings_table=Table("Exact settings", ["parameter", "value"], rows),
        **values_of(pairs, results, settings),
        **pictures_of(pairs, results, settings),
    )


def _say(text: str) -> None:
    """Show the progress on stderr."""
    say(f"reproduce_paper: {text}")


if __name__ == "__main__":
    sys.exit(main())
