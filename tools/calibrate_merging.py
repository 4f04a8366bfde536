"""Fit the confidence of alignments on pairs of maps whose truth is known, and tell what it is worth on others.

The weights that turn evidence into a probability are fitted on all pairs given. What they are worth is measured by
leaving out one building at a time, with its parts and its mirror image, fitting on the rest, and asking about the one
left out.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from merging.config import MergeConfig
    from tools.calibration_table import Judgement
    from tools.conditional_logit import Choice

EXAMPLES = """examples:
  python tools/%(prog)s.py pairs/ cut-anew/ -o merging/confidence_model.json
      fit on folders of pairs, as tools/make_map_pairs.py writes them, and on no other
  python tools/%(prog)s.py pairs/ --ask other-pairs/ --plot calibration.png
      what the model is worth on pairs that had no part in it; nothing is written but the picture

exit codes: 0 done, 1 something is wrong with the input (one line says what), 2 wrong usage
"""
PENALTY = 0.001
WHOLE = 3.0
"""A pair of a whole building counts for so many of a part of one, which ends where no building ends."""
SIMULATED = 0.3
"""What a pair of simulated buildings counts for beside a real one, which is what users have."""
MOST_PARTS = 12
"""The buildings are left out in so many parts, one by one where there are no more."""


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    args = _parser().parse_args(argv)
    from tbmslam.errors import TbmSlamError

    try:
        _run(args)
    except TbmSlamError as error:
        if args.debug:
            raise
        sys.stderr.write(f"calibrate_merging: {error}\n")
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    grammar = argparse.ArgumentParser(
        prog="calibrate_merging", description=__doc__, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    grammar.add_argument("pairs", nargs="+", type=Path, metavar="FOLDER", help="pairs to fit on")
    grammar.add_argument(
        "--simulated", nargs="*", type=Path, default=[], metavar="FOLDER",
        help=f"more pairs to fit on, each of which counts for {SIMULATED:g}",
    )  # fmt: skip
    grammar.add_argument("--ask", nargs="*", type=Path, default=[], metavar="FOLDER", help="pairs to ask about only")
    grammar.add_argument("-o", "--out", type=Path, metavar="FILE", help="where the fitted model goes")
    grammar.add_argument("--plot", type=Path, metavar="FILE", help="where a picture of the calibration goes")
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _run(args: argparse.Namespace) -> None:
    from merging.confidence import FEATURES, SIGNS
    from merging.config import MergeConfig
    from tbmslam.atomic_file import write_bytes, write_text
    from tools.calibration_plot import draw_calibration
    from tools.calibration_table import Judgement, calibration_table, worth
    from tools.conditional_logit import fit
    from tools.pair_benchmark import BINS

    config = MergeConfig()
    by_folder = {folder: choices_of(folder, config) for folder in args.pairs}
    by_folder |= {folder: choices_of(folder, config, SIMULATED) for folder in args.simulated}
    choices = [choice for folder in by_folder.values() for choice in folder]
    judged = _held_out(choices)
    in_order = iter(judged)
    for folder, its in by_folder.items():
        print(f"{folder}, buildings left out of the fit\n{worth(list(islice(in_order, len(its))))}\n")
    model = fit(choices, list(SIGNS.values()), PENALTY)
    for folder in args.ask:
        others = [Judgement.of(one, model) for one in choices_of(folder, config)]
        print(f"{folder}, no part in the fit\n{worth(others)}\n\n{calibration_table(others, BINS)}\n")
    print(f"all that were left out\n{calibration_table(judged, BINS)}")
    if args.plot:
        write_bytes(args.plot, draw_calibration([(one.confidence, one.right) for one in judged], BINS))
    if args.out:
        weights = {name: round(float(w), 6) for name, w in zip(FEATURES, model.weights, strict=True)}
        text = json.dumps({"pairs": len(choices), "bias": round(model.bias, 6), "weights": weights}, indent=2)
        write_text(args.out, text + "\n")


def choices_of(folder: Path, config: "MergeConfig", weight: float = 1.0) -> "list[Choice]":
    """Return the candidates of every pair in a folder, each of which counts for a weight.

    Raises
    ------
    PairFileError
        If a file there is no pair of maps, or there is none.
    """
    import numpy as np

    from merging.aligner import view_of
    from merging.candidates import find_candidates
    from merging.confidence import features
    from merging.decoys import find_decoys
    from tools.conditional_logit import Choice
    from tools.pair_files import PairFileError, load_pair
    from tools.pair_floors import shows_part

    choices = []
    for path in sorted(folder.glob("*.npz")):
        pair = load_pair(path)
        views = [view_of(one.grid, one.grid.geometry.resolution, config) for one in (pair.target, pair.source)]
        target, source = views
        if target is None or source is None:
            continue
        candidates = find_candidates(target.structure, source.structure, config)
        decoys = find_decoys(target.structure, source.structure, config)
        numbers = features([evidence for _, evidence in candidates], decoys)
        right, near = (np.array([of(m) for m, _ in candidates], dtype=np.bool_) for of in (pair.is_right, pair.is_near))
        choices.append(Choice(pair.name, numbers, right, weight if shows_part(pair.name) else WHOLE * weight, near))
    if not choices:
        raise PairFileError(f"{folder}: no .npz pair of maps there")
    return choices


def _held_out(choices: "Sequence[Choice]") -> "list[Judgement]":
    """Return what is said of each pair by a model that never met its building, or the first of its two."""
    from merging.confidence import SIGNS
    from tools.calibration_table import Judgement
    from tools.conditional_logit import fit
    from tools.pair_floors import floors_of

    shown = floors_of(choice.name for choice in choices)
    floors = sorted({floor for some in shown.values() for floor in some})
    parts = [set(floors[part::MOST_PARTS]) for part in range(min(MOST_PARTS, len(floors)))]
    signs = list(SIGNS.values())
    models = [fit([one for one in choices if not shown[one.name] & part], signs, PENALTY) for part in parts]
    judged = []
    for choice in choices:
        first = min(shown[choice.name], default=floors[0])
        model = next(model for part, model in zip(parts, models, strict=True) if first in part)
        judged.append(Judgement.of(choice, model))
    return judged


if __name__ == "__main__":
    sys.exit(main())
