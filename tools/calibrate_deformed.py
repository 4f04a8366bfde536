"""Fit the confidence of deformed maps on simulated pairs with known poses.

Few pairs of two places pass the tests of a deformed map, so many are tried. A merge of many maps tries far more pairs
of two places than of one. The pairs are weighted accordingly.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import cut_pairs
from merging.config import MergeConfig
from merging.nonrigid.deformed_model import DeformedModel
from tbmslam.io.atomic_file import write_text
from tbmslam.parallel.executor import Executor
from tools.benchmarks.strangers import building_of, meetings, pair_of_two_places, some_part
from tools.calibration.deformed_fit import DeformedTrial, fit_deformed, trial_of
from tools.command_line.options import number_within
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program
from tools.command_line.text_table import text_table
from tools.map_pairs.known_pair import KnownPair

EXAMPLES = """examples:
  python tools/%(prog)s.py -o merging/deformed_model.json
      takes an hour and a half of CPU time
"""
STRANGERS_PER_PAIR = 20.0
"""Number of pairs of two places for each pair of one place, as among the maps of twenty places."""
STRANGERS_SEED = 4901
"""Seed of `benchmark strangers` that the fit uses, and that cannot test the model."""
BENDS_M = (None, 0.15, 0.3)
"""Deformations of the maps of one place [m]; None is the usual one of 2 to 6 cm. Buildings take turns."""

_BUILDINGS_SEED = 9_100_000
_USUAL_OVERLAPS, _BENT_OVERLAPS = (0.5, 0.35, 0.25, 0.15), (1.0, 0.5, 0.35, 0.25)
_CHUNK = 8
"""Number of pairs or buildings that a process takes at a time."""


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    args = _parser().parse_args(argv)
    return run_program("calibrate_deformed", lambda: _run(args), debug=args.debug)


def _parser() -> ProgramParser:
    grammar = ProgramParser(prog="calibrate_deformed", description=__doc__, epilog=EXAMPLES)
    count = number_within(int, 1)
    grammar.add_argument("--buildings", type=count, default=120, metavar="N", help="buildings of one place (120)")
    grammar.add_argument("--strangers", type=count, default=7500, metavar="N", help="pairs of two places (7500)")
    grammar.add_argument("-o", "--out", type=path_argument, metavar="FILE", help="write the fitted model here")
    grammar.add_argument("--workers", type=count, default=2, metavar="N", help="processes; the result is the same (2)")
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _run(args: argparse.Namespace) -> None:
    weight = STRANGERS_PER_PAIR * len(_USUAL_OVERLAPS) * args.buildings / args.strangers
    trials = [
        trial
        for meeting, tasks in (
            (trials_of_building, [(number,) for number in range(args.buildings)]),
            (trials_of_strangers, [(number, weight) for number in range(args.strangers)]),
        )
        for found in meetings(meeting, tasks, Executor(args.workers), _CHUNK)
        for trial in found
        if trial is not None
    ]
    model = fit_deformed(trials)
    print(_report(trials, model))
    if args.out:
        write_text(args.out, model.as_json())


def pairs_of_building(number: int) -> Iterator[KnownPair]:
    """Yield pairs of maps of a simulated building, or of a part of one."""
    rng = np.random.default_rng([_BUILDINGS_SEED, number])
    building = some_part(building_of(_BUILDINGS_SEED + number, rng), rng)
    bend_m = BENDS_M[number % len(BENDS_M)]
    draw = Distortion.draw if bend_m is None else partial(Distortion.of_another_time, deformation_m=bend_m)
    overlaps = _USUAL_OVERLAPS if bend_m is None else _BENT_OVERLAPS
    yield from map(KnownPair.of, cut_pairs(building, int(rng.integers(2**31)), overlaps, draw))


def trials_of_building(number: int) -> list[DeformedTrial | None]:
    """Return the attempts at the pairs of a simulated building."""
    return [trial_of(pair) for pair in pairs_of_building(number)]


def trials_of_strangers(number: int, weight: float) -> list[DeformedTrial | None]:
    """Return the attempt at a pair of two places, with a weight."""
    return [trial_of(pair_of_two_places(number, STRANGERS_SEED), weight)]


def _report(trials: Sequence[DeformedTrial], model: DeformedModel) -> str:
    """Return a table of the attempts that are likely by the tests, and by the model."""
    least = MergeConfig().verification.min_confidence
    passed = [trial for trial in trials if trial.tests.less_certain >= least]
    kept = [trial for trial in passed if model.confidence(trial.tests) >= least]
    rows = [
        [name, *(str(sum(trial.right == right for trial in some)) for right in (True, False))]
        for name, some in (("used", trials), ("passed both tests", passed), ("likely by the model", kept))
    ]
    return text_table(["attempts", "right", "wrong"], rows)


if __name__ == "__main__":
    sys.exit(main())
