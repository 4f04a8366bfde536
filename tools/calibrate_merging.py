"""Fit the confidence of alignments on pairs of maps whose truth is known, and tell what it is worth on others.

The weights that turn evidence into a probability are fitted on all pairs given. What they are worth is measured by
leaving out one part of the buildings at a time, fitting on the rest, and asking about those left out.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from merging.config import MergeConfig
    from tools.conditional_logit import Choice

EXAMPLES = """examples:
  python tools/%(prog)s.py pairs/ -o merging/confidence_model.json
      fit on a folder of pairs, as tools/make_map_pairs.py writes them, and on no other
  python tools/%(prog)s.py pairs/ --ask other-pairs/ --plot calibration.png
      what the model is worth on pairs that had no part in it; nothing is written but the picture

exit codes: 0 done, 1 something is wrong with the input (one line says what), 2 wrong usage
"""
SIGNS = (1, 1, 1, -1, -1, -1, -1, -1, 1, -1, 0, 0, 1)
"""Which features can only speak for (1) or against (-1) a candidate; in the order of `merging.confidence.FEATURES`."""
PENALTY = 0.003
PARTS = 5


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
    grammar.add_argument("--ask", nargs="*", type=Path, default=[], metavar="FOLDER", help="pairs to ask about only")
    grammar.add_argument("-o", "--out", type=Path, metavar="FILE", help="where the fitted model goes")
    grammar.add_argument("--plot", type=Path, metavar="FILE", help="where a picture of the calibration goes")
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def _run(args: argparse.Namespace) -> None:
    from merging.confidence import FEATURES
    from merging.config import MergeConfig
    from tbmslam.atomic_file import write_bytes, write_text
    from tools.calibration_plot import draw_calibration
    from tools.conditional_logit import fit
    from tools.pair_benchmark import BINS

    config = MergeConfig()
    choices = choices_of(args.pairs, config)
    judged = _held_out(choices)
    print("held out by building:", _worth(judged))
    model = fit(choices, SIGNS, PENALTY)
    for folder in args.ask:
        others = choices_of([folder], config)
        judged = [_best(model.probabilities(one.features), one) for one in others]
        print(f"{folder}:", _worth(judged))
    if args.plot:
        write_bytes(args.plot, draw_calibration(judged, BINS))
    if args.out:
        weights = {name: round(float(w), 6) for name, w in zip(FEATURES, model.weights, strict=True)}
        text = json.dumps({"pairs": len(choices), "bias": round(model.bias, 6), "weights": weights}, indent=2)
        write_text(args.out, text + "\n")


def choices_of(folders: Sequence[Path], config: "MergeConfig") -> "list[Choice]":
    """Return the candidates of every pair in some folders.

    Raises
    ------
    PairFileError
        If a file there is no pair of maps, or there is none.
    """
    import numpy as np

    from merging.aligner import view_of
    from merging.candidates import find_candidates
    from merging.confidence import features
    from tools.conditional_logit import Choice
    from tools.pair_files import PairFileError, load_pair

    choices = []
    for path in [path for folder in folders for path in sorted(folder.glob("*.npz"))]:
        pair = load_pair(path)
        views = [view_of(one.grid, one.grid.geometry.resolution, config) for one in (pair.target, pair.source)]
        target, source = views
        if target is None or source is None:
            continue
        candidates = find_candidates(target.structure, source.structure, config)
        numbers = features([evidence for _, evidence in candidates])
        right = np.array([pair.is_right(motion) for motion, _ in candidates], dtype=np.bool_)
        choices.append(Choice(pair.name, pair.building, numbers, right))
    if not choices:
        raise PairFileError(f"{', '.join(map(str, folders))}: no .npz pair of maps there")
    return choices


def _held_out(choices: "Sequence[Choice]") -> list[tuple[float, bool]]:
    """Return confidence and truth of every pair's best place, by a model that never met the pair's building."""
    from tools.conditional_logit import fit

    buildings = sorted({choice.building for choice in choices})
    judged = []
    for part in range(PARTS):
        asked = set(buildings[part::PARTS])
        model = fit([one for one in choices if one.building not in asked], SIGNS, PENALTY)
        judged += [_best(model.probabilities(one.features), one) for one in choices if one.building in asked]
    return judged


def _best(probabilities: "object", choice: "Choice") -> tuple[float, bool]:
    import numpy as np

    p = np.asarray(probabilities)
    return (float(p.max()), bool(choice.right[int(p.argmax())])) if len(p) else (0.0, False)


def _worth(judged: Sequence[tuple[float, bool]]) -> str:
    accepted = [right for confidence, right in judged if confidence >= 0.9]
    right = sum(accepted)
    return f"{len(judged)} pairs, {right} accepted rightly, {len(accepted) - right} wrongly at a confidence of 0.9"


if __name__ == "__main__":
    sys.exit(main())
