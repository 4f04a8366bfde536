"""Fit the confidence of alignments on pairs of maps with known poses, and evaluate it.

The weights of the evidence are fitted on all given pairs. The model is evaluated by cross-validation: each building,
with its parts and its mirror image, is left out of the fit once.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from merging.config import MergeConfig
from tbmslam.io.atomic_file import write_bytes, write_text
from tbmslam.parallel.executor import Call, Executor
from tools.benchmarks.strangers import meetings, pair_of_two_places
from tools.calibration.calibration_report import BINS, acceptance_table, calibration_table, draw_calibration
from tools.calibration.model_fit import fit_model, held_out
from tools.calibration.trial import Trial
from tools.command_line.options import add_plot_option, check_plot, number_within
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program
from tools.map_pairs.floors import shows_part
from tools.map_pairs.known_pair import PairFileError, load_pair

EXAMPLES = """examples:
  python tools/calibrate_merging.py pairs/ new-pairs/ -o merging/confidence_model.json
      fit on folders of pairs that tools/make_map_pairs.py wrote
  python tools/calibrate_merging.py pairs/ --plot calibration.png
      only evaluate the model; a picture of the calibration is written
"""
WHOLE = 3.0
"""Weight of a pair of whole buildings. A pair of parts has the weight 1, because the borders of parts are arbitrary."""
SIMULATED = 0.3
"""Weight of a pair of simulated buildings; real buildings have 1."""


STRANGERS_SEED = 1
"""Seed of `benchmark strangers` that the fit uses, and that cannot test the model."""
_CHUNK = 24  # number of strangers that a process takes at a time; many of them share a building


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    args = _parser().parse_args(argv)
    return run_program("calibrate_merging", lambda: _run(args), debug=args.debug)


def _parser() -> ProgramParser:
    grammar = ProgramParser(prog="calibrate_merging", description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("pairs", nargs="+", type=path_argument, metavar="FOLDER", help="pairs to fit on")
    grammar.add_argument(
        "--simulated", nargs="*", type=path_argument, default=[], metavar="FOLDER",
        help=f"more pairs to fit on, each of which counts for {SIMULATED:g}",
    )  # fmt: skip
    grammar.add_argument(
        "--bent", nargs="*", type=path_argument, default=[], metavar="FOLDER",
        help=f"more pairs to fit on, with one map of each deformed; each counts for {SIMULATED:g}",
    )  # fmt: skip
    grammar.add_argument(
        "--strangers", type=number_within(int, 0), default=0, metavar="N",
        help=f"N pairs of `benchmark strangers --seed {STRANGERS_SEED}` to fit on; each counts for {SIMULATED:g}",
    )  # fmt: skip
    grammar.add_argument("-o", "--out", type=path_argument, metavar="FILE", help="write the fitted model here")
    add_plot_option(grammar, "the calibration")
    grammar.add_argument(
        "--workers", type=number_within(int, 1), default=2, metavar="N", help="processes; the result is the same (2)"
    )
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _run(args: argparse.Namespace) -> None:
    check_plot(args.plot)
    config, executor = MergeConfig(), Executor(args.workers)
    pairs = [(str(folder), pairs_of(folder)) for folder in args.pairs]
    pairs += [(str(folder), pairs_of(folder, SIMULATED)) for folder in args.simulated]
    pairs += [(f"{folder}, bent", pairs_of(folder, SIMULATED, bent=True)) for folder in args.bent]
    groups = trials_of(pairs, config, executor)
    if args.strangers:
        groups.append(("strangers", strangers(args.strangers, config, executor)))
    trials = [trial for _, group in groups for trial in group]
    judged = held_out(trials, executor)
    in_order = iter(judged)
    for name, group in groups:
        table = acceptance_table(list(islice(in_order, len(group))))
        print(f"{name}, by models fitted without its buildings\n{table}\n")
    print(f"all pairs, by models fitted without their buildings\n{calibration_table(judged, BINS)}")
    if args.plot:
        write_bytes(args.plot, draw_calibration(judged, BINS))
    if args.out:
        write_text(args.out, fit_model(trials).as_json())


@dataclass(frozen=True)
class FittedPair:
    """A pair to fit on."""

    path: Path
    weight: float
    """Weight of a pair of parts."""
    bent: bool
    """Whether one of its maps is deformed."""


def pairs_of(folder: Path, weight: float = 1.0, *, bent: bool = False) -> list[FittedPair]:
    """Return all pairs in a folder."""
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise PairFileError(f"{folder}: no .npz pair of maps there")
    return [FittedPair(path, weight, bent) for path in paths]


def trials_of(
    groups: Sequence[tuple[str, Sequence[FittedPair]]], config: MergeConfig, executor: Executor
) -> list[tuple[str, list[Trial]]]:
    """Return the trials of all pairs of each group by its name."""
    pairs = [pair for _, group in groups for pair in group]
    trials = iter(executor.results([Call(f"{k}", _trial_of, (pair, config)) for k, pair in enumerate(pairs)]))
    return [(name, [one for one in islice(trials, len(group)) if one is not None]) for name, group in groups]


def _trial_of(fitted: FittedPair, config: MergeConfig) -> Trial | None:
    pair = load_pair(fitted.path)
    of = Trial.of_deformed if fitted.bent else Trial.of
    return of(pair, config, fitted.weight if shows_part(pair.name) else WHOLE * fitted.weight)


def strangers(count: int, config: MergeConfig, executor: Executor) -> list[Trial]:
    """Return the trials of simulated pairs of different places."""
    tasks = [(number, config) for number in range(count)]
    return [trial for trial in meetings(_stranger, tasks, executor, _CHUNK) if trial is not None]


def _stranger(number: int, config: MergeConfig) -> Trial | None:
    return Trial.of(pair_of_two_places(number, STRANGERS_SEED), config, SIMULATED)


if __name__ == "__main__":
    sys.exit(main())
