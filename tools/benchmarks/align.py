"""Correct and false alignments of pairs of maps with known truth, and the calibration of the confidence."""

import argparse
import math
import statistics
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from merging.baselines.howard import Encounter, measured
from tbmslam.belief.grid import TbmGrid, walls_and_free
from tbmslam.geometry.se2 import SE2, BoolArray
from tools.calibration.calibration_report import BINS, calibration_table
from tools.command_line.measurement_record import finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table
from tools.map_pairs.known_pair import KnownPair

if TYPE_CHECKING:
    from merging.alignment import Alignment


SUMMARY_NOTES = """\
By overlap: accepted and right. error m, error deg: medians of these. in deviations: RMS of their errors in stated
standard deviations. CPU s, most: median and maximum of a pair. ambiguous: refused as ambiguous. bent: accepted
after one map was deformed."""

COMPARISON_NOTES = """\
By overlap: accepted and right. best place right: accepted or not. CPU s: median of a pair."""


@dataclass(frozen=True)
class PairResult:
    """The result of one pair."""

    name: str
    overlap: int | None
    """Overlap in percent; None if the maps show different places."""
    accepted: bool
    """Whether the best pose was accepted."""
    right: bool
    """Whether the best pose is the true pose."""
    ambiguous: bool
    """Whether the pair was refused because several poses fit well."""
    confidence: float
    """Stated probability that the pose is right."""
    translation_error_m: float | None
    rotation_error_deg: float | None
    """Errors of the best pose; None without a truth."""
    surprise: float | None
    """Mean square of the errors in stated standard deviations; its expected value is 1."""
    bent_m: float
    """RMS deformation of one of the maps [m]."""
    cpu_s: float
    """CPU time of both maps and their alignment [s]."""
    reason: str


def benchmark_pairs(args: argparse.Namespace) -> None:
    """Align all pairs of a folder and print the tables."""
    from tbmslam.errors import TbmSlamError

    paths = sorted(args.pairs.glob("*.npz"))
    if not paths:
        raise TbmSlamError(f"{args.pairs} holds no .npz pair of maps: give the folder that does")
    results = {method: _measure_all(paths, method) for method in args.method}
    first = results[args.method[0]]
    if len(results) > 1:
        table = comparison(results)
        print(text_table(*table) + "\n" + COMPARISON_NOTES)
    else:
        table = summary(first, args.method[0])
        print(text_table(*table) + "\n" + SUMMARY_NOTES + "\n")
        print(calibration_table(first, BINS))
    if args.details:
        for method, found in results.items():
            print(f"\n{method}\n{details(found)}")
    finish(args, {"methods": table}, {"methods": results})


def _measure_all(paths: Sequence[Path], method: str) -> list[PairResult]:
    measure(paths[0], method)  # compiles
    results = []
    for path in paths:
        results.append(measure(path, method))
        say(f"benchmark: {method} {path.stem}: {results[-1].reason}")
    return results


def measure(path: Path, method: str) -> PairResult:
    """Align one pair."""
    from merging import align
    from merging.baselines import howard
    from merging.config import MergeConfig
    from tools.map_pairs.known_pair import load_pair

    pair = load_pair(path)
    encounters = encounters_of(pair)
    start = time.process_time()
    if method == "howard":
        found = howard.align(encounters)
    else:
        found = align(pair.target, pair.source, MergeConfig.model_validate({"method": method}))
    cpu_s = time.process_time() - start
    errors: tuple[float | None, float | None] = (None, None)
    if pair.T_target_source is not None and found.T_target_source is not None:
        errors = pair.errors(found.T_target_source)
    return PairResult(
        name=pair.name,
        overlap=None if pair.T_target_source is None else round(100.0 * pair.overlap),
        accepted=found.accepted,
        right=pair.is_right(found.T_target_source),
        ambiguous=found.ambiguous,
        confidence=found.confidence,
        translation_error_m=errors[0],
        rotation_error_deg=errors[1],
        surprise=_surprise(found, pair.T_target_source),
        bent_m=found.bent_m,
        cpu_s=cpu_s,
        reason=found.reason,
    )


def summary(results: Sequence[PairResult], method: str) -> ResultTable:
    """Return the table of correct alignments by overlap, and of false ones."""
    true = [result for result in results if result.overlap is not None]
    right = [r for r in true if r.accepted and r.right]
    metres = [r.translation_error_m for r in right if r.translation_error_m is not None]
    degrees = [r.rotation_error_deg for r in right if r.rotation_error_deg is not None]
    surprises = [r.surprise for r in right if r.surprise is not None]
    cpu = [r.cpu_s for r in results]
    row = {
        "method": method,
        "pairs": str(len(results)),
        **_by_overlap(true, _overlaps(true)),
        **_false_accepts(results),
        "error m": number(_median(metres), 3),
        "error deg": number(_median(degrees), 2),
        "in deviations": f"{math.sqrt(statistics.fmean(surprises)):.2f}" if surprises else "-",
        "CPU s": number(_median(cpu), 2),
        "most": f"{max(cpu):.2f}",
        "ambiguous": str(sum(r.ambiguous for r in results)),
        "bent": str(sum(r.accepted and r.bent_m > 0.0 for r in results)),
    }
    return ResultTable.of([row])


def comparison(results: Mapping[str, Sequence[PairResult]]) -> ResultTable:
    """Return one table of several methods on the same pairs."""
    rows, overlaps = [], _overlaps([result for found in results.values() for result in found])
    for method, found in results.items():
        true = [result for result in found if result.overlap is not None]
        cpu = [r.cpu_s for r in found]
        row = {
            "method": method,
            **_by_overlap(true, overlaps),
            "all": _share(true),
            **_false_accepts(found),
            "best place right": str(sum(r.right for r in true)),
            "CPU s": number(_median(cpu), 2),
            "most": f"{max(cpu):.2f}",
        }
        rows.append(row)
    return ResultTable.of(rows)


def details(results: Sequence[PairResult]) -> str:
    """Return a line for every pair with a wrong decision or a true pose that was refused."""
    odd = [r for r in results if (r.accepted != r.right) or (r.overlap is not None and not r.accepted)]
    rows = [[r.name, r.reason, f"{r.confidence:.3f}", "right" if r.right else "wrong"] for r in odd]
    return text_table(["pair", "reason", "confidence", "best place"], rows) if rows else "all decisions are right"


def _overlaps(results: Sequence[PairResult]) -> list[int]:
    return sorted({result.overlap for result in results if result.overlap is not None}, reverse=True)


def _by_overlap(true: Sequence[PairResult], overlaps: Sequence[int]) -> dict[str, str]:
    return {f"{overlap} %": _share([r for r in true if r.overlap == overlap]) for overlap in overlaps}


def _false_accepts(results: Sequence[PairResult]) -> dict[str, str]:
    """Return the numbers of false accepts, of pairs of one place and of pairs of different places."""
    negatives = [result for result in results if result.overlap is None]
    wrong = sum(r.accepted and not r.right for r in results if r.overlap is not None)
    return {
        "wrong but accepted": str(wrong),
        "negatives accepted": f"{sum(r.accepted for r in negatives)} of {len(negatives)}",
    }


def _share(results: Sequence[PairResult]) -> str:
    return f"{sum(r.accepted and r.right for r in results)}/{len(results)}" if results else "-"


def _surprise(found: "Alignment", truth: SE2 | None) -> float | None:
    if found.T_target_source is None or found.covariance is None or truth is None:
        return None
    error = np.array(found.T_target_source.to(truth).log())
    return float(error @ np.linalg.solve(np.array(found.covariance), error)) / 3.0


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None


_WITHIN_M = 3.0  # largest distance of robots that meet [m]


def encounters_of(pair: KnownPair) -> list[Encounter]:
    """Return a simulated encounter of the two robots where both maps are free; none if they share no free cell.

    The position, the headings and the error of the measurement are drawn with the pair's name as the seed.
    """
    if pair.T_target_source is None:
        return []
    rng = np.random.default_rng(zlib.crc32(pair.name.encode()))
    source = pair.source.grid.geometry.centres_of(*np.nonzero(_free(pair.source.grid)))
    rows, cols, inside = pair.target.grid.geometry.cells_at(pair.T_target_source.apply(source))
    shared = source[inside & _free(pair.target.grid)[rows, cols]]
    if len(shared) == 0:
        return []
    here = shared[rng.integers(len(shared))]
    near = shared[np.linalg.norm(shared - here, axis=1) <= _WITHIN_M]
    there = near[rng.integers(len(near))]
    headings = rng.uniform(-np.pi, np.pi, 2)
    T_target_robot = pair.T_target_source @ SE2(float(here[0]), float(here[1]), float(headings[0]))
    T_source_other = SE2(float(there[0]), float(there[1]), float(headings[1]))
    return [measured(T_target_robot, T_source_other, pair.T_target_source, rng)]


def _free(grid: TbmGrid) -> BoolArray:
    return walls_and_free(grid)[1]
