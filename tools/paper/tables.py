"""The tables of the report on the paper's experiments, and the numbers in its sentences."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.report.page import Table
from tools.paper.detectors import AS_PROGRAMMED, AS_WRITTEN, DETECTORS, MODIFICATIONS, Setting, Study, Variant
from tools.paper.experiments import PaperResults, PaperSettings
from tools.paper.map_pair import MapPair
from tools.paper.published import (
    LEVEL,
    TABLE_1,
    TABLE_2,
    TABLE_3,
    TABLE_4,
    TEST,
    indistinguishable_from_best,
    paired_p_value,
)

_NO_VALUE = "–"
_ABSENT = ("SURF", "BRIEF")
"""Detectors of the paper's table I that the required package of OpenCV does not have."""
_READINGS = {"as written": AS_WRITTEN, "as programmed": AS_PROGRAMMED}


def values_of(pairs: Sequence[MapPair], results: PaperResults, settings: PaperSettings) -> dict[str, object]:
    """Return all tables and numbers by their names in the template."""
    return {
        "level": LEVEL,
        "test": TEST,
        "conclusions": conclusions(results),
        "pair_table": _pair_table(pairs),
        "detector_table": _detector_table(results),
        "published_table_1": Table(
            "The paper's table I", ["pair", *TABLE_1], _numbered(zip(*TABLE_1.values(), strict=True))
        ),
        **_modification_values(results, settings),
        **_transform_values(results),
        "published_table_3": Table("The paper's table III", ["pair", "min m", "max m", "gmean m"], _numbered(TABLE_3)),
        "duration_table": _duration_table(results),
        "published_table_4": _published_duration_table(),
        **_halves_values(results),
    }


def _numbered(rows: Iterable[Sequence[float]]) -> list[list[str]]:
    return [[str(number), *(f"{value:.3f}" for value in row)] for number, row in enumerate(rows, 1)]


def _pair_table(pairs: Sequence[MapPair]) -> Table:
    rows = [[pair.name, f"{pair.overlap():.2f}", *(f"{v:.2f}" for v in pair.T_target_source)] for pair in pairs]
    return Table("Pairs", ["pair", "overlap", "x m", "y m", "theta rad"], rows)


def _detector_table(results: PaperResults) -> Table:
    none = [_NO_VALUE] * len(_ABSENT)
    rows = [
        [pair, *(f"{_share(by[name].share_right)} of {by[name].matches}" for name in DETECTORS), *none]
        for pair, by in results.detectors.items()
    ]
    by_pair = results.detectors.values()
    right = [_share(_mean(np.array([by[name].share_right for by in by_pair]))) for name in DETECTORS]
    inliers = [_share(_mean(np.array([by[name].share_inliers for by in by_pair]))) for name in DETECTORS]
    columns = [*DETECTORS, *_ABSENT]
    theirs = [_share(_mean(np.array(TABLE_1[name]))) if name in TABLE_1 else _NO_VALUE for name in columns]
    rows += [
        ["mean here", *right, *none],
        ["what RANSAC calls inliers", *inliers, *none],
        ["the paper's mean", *theirs],
    ]
    return Table("Measured here", ["pair", *columns], rows)


class Wins(NamedTuple):
    """Numbers of settings in which a modification is better, is significantly better, and of all."""

    higher: int
    sure: int
    settings: int


def conclusions(results: PaperResults) -> list[tuple[str, Wins, Wins]]:
    """Return the results on the paper's main conclusion that concatenated descriptors are the best.

    For each reading of the paper: its name, the wins of (e) over (b), and those of (b) over (a).
    """
    studies = {name: results.studies[variant] for name, variant in _READINGS.items()}
    return [(name, _wins(study, "e", "b"), _wins(study, "b", "a")) for name, study in studies.items()]


def _wins(study: Study, first: str, other: str) -> Wins:
    higher = sure = total = 0
    for row in _rows_of(study):
        mine, theirs = (study.shares[Setting(*row, letter)] for letter in (first, other))
        total += 1
        if _mean(mine - theirs) > 0.0:
            higher += 1
            sure += paired_p_value(theirs, mine) <= 1.0 - LEVEL
    return Wins(higher, sure, total)


def _rows_of(study: Study) -> Iterator[tuple[int, float]]:
    """Yield the numbers of keypoints and the ratios of a study: the rows of table II."""
    yield from dict.fromkeys((setting.keypoints, setting.ratio) for setting in study.shares)


def _modification_values(results: PaperResults, settings: PaperSettings) -> dict[str, object]:
    """Return the tables and the numbers on table II."""
    written, programmed = results.studies[AS_WRITTEN], results.studies[AS_PROGRAMMED]

    def shares(variant: Variant, letter: str) -> FloatArray:
        return results.studies[variant].shares[Setting(settings.default_keypoints, settings.default_ratio, letter)]

    concatenated = shares(AS_WRITTEN, "b")
    heads = ("keypoints", "ratio", *MODIFICATIONS, "best")
    titles = {
        "As the paper is written: 128 bits an image, the unknown mass as it is": written,
        "As its program is: 256 bits an image, the unknown mass inverted": programmed,
    }
    return {
        "found": "; ".join(f"{asked}: {counts.mean():.0f}" for asked, counts in written.found.items()),
        "gain": _compared(shares(AS_WRITTEN, "a"), concatenated),
        "longer": _compared(concatenated, shares(Variant(256, "as it is"), "b")),
        "inverted": _compared(concatenated, shares(Variant(128, "inverted"), "b")),
        "near": "; ".join(f"{name}: {_near_paper(results.studies[variant])}" for name, variant in _READINGS.items()),
        "modification_tables": [
            *(Table(title, heads, _modification_rows(study)) for title, study in titles.items()),
            _variants_table(results, settings),
        ],
    }


def _near_paper(study: Study) -> str:
    """Return the number of means within 0.1 of the paper's, by modification."""
    rows = [row for row in _rows_of(study) if row in TABLE_2]
    near = {
        letter: sum(
            abs(_mean(study.shares[Setting(*row, letter)]) - TABLE_2[row].values[letter][0]) <= 0.1 for row in rows
        )
        for letter in MODIFICATIONS
    }
    return ", ".join(f"{letter} {count}" for letter, count in near.items()) + f" of {len(rows)}"


def _modification_rows(study: Study) -> list[list[str]]:
    rows = []
    for row in _rows_of(study):
        values = {letter: study.shares[Setting(*row, letter)] for letter in MODIFICATIONS}
        cells = [_spread(values[letter]) for letter in MODIFICATIONS]
        best = ", ".join(indistinguishable_from_best(values))
        if (theirs := TABLE_2.get(row)) is not None:
            means = [theirs.values[letter] for letter in MODIFICATIONS]
            cells = [f"{ours}\n{mean:.2f} ± {spread:.2f}" for ours, (mean, spread) in zip(cells, means, strict=True)]
            best += f"\n{', '.join(theirs.best)}"
        rows.append([str(row[0]), f"{row[1]:g}", *cells, best])
    return rows


def _variants_table(results: PaperResults, settings: PaperSettings) -> Table:
    at = settings.default_keypoints, settings.default_ratio
    rows = []
    for variant, study in results.studies.items():
        chosen = [Setting(*at, letter) for letter in MODIFICATIONS]
        cells = [f"{_spread(study.shares[each])}\n{study.matches[each].mean():.0f} matches" for each in chosen]
        rows.append([f"{variant.bits} bits", variant.unknown, *cells])
    return Table(f"Variants at {at[0]} keypoints and ratio {at[1]:g}", ("an image", "unknown", *MODIFICATIONS), rows)


def _transform_values(results: PaperResults) -> dict[str, object]:
    """Return table III, and the means of its geometric means and of the true errors of the affine transforms [m]."""
    rows = []
    for name, result in results.transforms.items():
        metres = (
            *(result.least_m, result.most_m, result.geometric_mean_m),
            *(result.affine_error_m, result.rigid_error_m, result.default_error_m),
        )
        cells = [_NO_VALUE if value is None else f"{value:.3f}" for value in metres]
        rows.append([name, str(result.matches), str(result.right), *cells])
    heads = (
        *("pair", "matches", "right", "min m", "max m", "gmean m"),
        *("affine, true error m", "rigid, true error m", "default, true error m"),
    )
    fitted = [
        (result.geometric_mean_m, result.affine_error_m)
        for result in results.transforms.values()
        if result.geometric_mean_m is not None and result.affine_error_m is not None
    ]
    return {
        "transform_table": Table("Measured here", heads, rows),
        "fitted": np.mean(fitted, axis=0).tolist() if fitted else None,
    }


def _duration_table(results: PaperResults) -> Table:
    rows = []
    for name, result in results.durations.items():
        mean, deviation = float(result.milliseconds.mean()), float(result.milliseconds.std(ddof=1))
        rows.append([name, f"{result.area_m2:.0f}", f"{mean:.0f}", f"{deviation:.0f}", f"{mean / result.area_m2:.4f}"])
    return Table("Measured here", ["pair", "area m²", "mean ms", "deviation ms", "ms a m²"], rows)


def _published_duration_table() -> Table:
    rows = [
        [str(number), f"{area:.0f}", f"{mean:.1f}", f"{deviation:.1f}", f"{mean / area:.4f}"]
        for number, (area, mean, deviation) in enumerate(TABLE_4, 1)
    ]
    return Table("The paper's table IV", ["pair", "area m²", "mean 's'", "deviation 's'", "'s' a m²"], rows)


def _halves_values(results: PaperResults) -> dict[str, object]:
    """Return the table of figure 2, and the mean mass on unknown in the common strip of the parts."""
    halves = results.halves
    rows = [
        [name, f"{halves.known_share(grid):.1%}", f"{halves.unknown_in_overlap(grid):.3f}"]
        for name, grid in halves.fused().items()
    ]
    heads = ["rule", "share of known cells", "mean mass on unknown in the strip"]
    before = (halves.unknown_in_overlap(halves.left) + halves.unknown_in_overlap(halves.right)) / 2.0
    return {"halves_table": Table("Fused maps", heads, rows), "unknown_before": before}


def _compared(before: FloatArray, after: FloatArray) -> str:
    p_value = paired_p_value(before, after)
    sure = "significant" if p_value <= 1.0 - LEVEL else "not significant"
    return f"from {_share(_mean(before))} to {_share(_mean(after))} (p = {p_value:.3f}, {sure})"


def _spread(values: FloatArray) -> str:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return _NO_VALUE
    return f"{finite.mean():.2f}" + (f" ± {finite.std(ddof=1):.2f}" if len(finite) > 1 else "")


def _mean(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _share(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else _NO_VALUE
