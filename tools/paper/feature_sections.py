"""The report's sections on keypoints: tables I and II, figure 3."""

from collections.abc import Sequence

import numpy as np

from merging.experiments.detectors import AS_PROGRAMMED, AS_WRITTEN, DETECTORS, MODIFICATIONS, Setting, Study, Variant
from merging.experiments.published import (
    LEVEL,
    TABLE_1,
    TABLE_2,
    TEST,
    indistinguishable_from_best,
    paired_p_value,
    table_2,
)
from tbmslam.geometry.se2 import FloatArray
from tbmslam.report.page import Table
from tools.paper.experiments import PaperResults, PaperSettings
from tools.paper.page import PaperPicture, Section, draw_curves

_NO_VALUE = "–"


_ABSENT = ("SURF", "BRIEF")
"""Detectors of the paper's table I that the required package of OpenCV does not have."""


def detector_section(results: PaperResults, settings: PaperSettings) -> Section:
    """Table I."""
    names, none = list(DETECTORS), [_NO_VALUE] * len(_ABSENT)
    rows = [
        [pair, *(f"{_share(by[name].share_right)} of {by[name].matches}" for name in names), *none]
        for pair, by in results.detectors.items()
    ]
    right = {n: np.array([by[n].share_right for by in results.detectors.values()]) for n in names}
    inliers = {n: np.array([by[n].share_inliers for by in results.detectors.values()]) for n in names}
    rows.append(["mean here", *(_share(_mean(right[n])) for n in names), *none])
    rows.append(["what RANSAC calls inliers", *(_share(_mean(inliers[n])) for n in names), *none])
    columns = [*names, *_ABSENT]
    theirs = [_share(_mean(np.array(TABLE_1[n]))) if n in TABLE_1 else _NO_VALUE for n in columns]
    rows.append(["the paper's mean", *theirs])
    published = [[str(number + 1), *(f"{TABLE_1[n][number]:.3f}" for n in TABLE_1)] for number in range(7)]
    return Section(
        "Table I: detectors and descriptors",
        [
            (
                f"About {settings.default_keypoints} keypoints of the pignistic image of each map, matched by brute "
                f"force, Lowe's ratio {settings.default_ratio:g}; share of the matches within {settings.tolerance_m:g} "
                "m of their true positions, and number of matches. Differences to the paper:"
            ),
            (
                "Right matches. Here the truth is known. The paper does not define right matches. Without a truth one "
                "may count the inliers of the fitted transform, so the table also has their share. Their tolerance is "
                f"3 cells instead of {settings.tolerance_m:g} m. They are an estimate: wrong transforms have inliers."
            ),
            (
                "Descriptors. SURF and BRIEF are only in OpenCV's contrib package, so their columns are empty. AKAZE "
                "is added. The number of keypoints of BRISK and AKAZE cannot be requested: the strongest are used."
            ),
            (
                "Maps. For some of the paper's seven pairs, SIFT and SURF have no right match (0.0). Pairs of fully "
                "explored maps of one building, as here, are easier. So compare columns, not cells."
            ),
        ],
        [
            Table("Measured here", ["pair", *columns], rows),
            Table("The paper's table I", ["pair", *TABLE_1], published),
        ],
    )


def modification_section(results: PaperResults, settings: PaperSettings) -> Section:
    """Table II."""
    written, programmed = results.studies[AS_WRITTEN], results.studies[AS_PROGRAMMED]
    found = "; ".join(f"{asked}: {counts.mean():.0f}" for asked, counts in written.found.items())
    return Section(
        "Table II: modifications of the descriptor",
        [
            (
                "Share of right matches, mean ± standard deviation over the pairs, and in grey the paper's value. a: "
                "the pignistic image alone; b: descriptors of the occupied, free and unknown image concatenated; c, d, "
                "e: these three joined by and, or, exclusive or. The last column has those that no other beats "
                f"significantly at {LEVEL:g}. Test: {TEST}. The test assumes independent pairs, but pairs that share a "
                "map are not independent. The paper does not name its test."
            ),
            (
                f"Keypoints found in each map, by the requested number: {found}. A dash: no match passed the ratio "
                "test. A strict test has a high share of few matches; the table of variants also has the numbers."
            ),
            *_variant_texts(results, settings),
        ],
        [
            Table("As the paper is written: 128 bits an image, the unknown mass as it is", _HEADS, _rows(written)),
            Table("As its program is: 256 bits an image, the unknown mass inverted", _HEADS, _rows(programmed)),
            _variants_table(results, settings),
        ],
    )


_READINGS = {"as written": AS_WRITTEN, "as programmed": AS_PROGRAMMED}


def conclusions(results: PaperResults) -> list[str]:
    """Return the results on the paper's main conclusion that concatenated descriptors are the best."""
    sentences = []
    for name, variant in _READINGS.items():
        study = results.studies[variant]
        joined, plain = _wins(study, "e", "b"), _wins(study, "b", "a")
        sentences.append(
            f"Read {name}, descriptors joined by exclusive or (e) have a higher share of right matches than "
            f"concatenated ones (b) in {joined[0]} of {joined[2]} settings, in {joined[1]} of them at "
            f"p <= {1.0 - LEVEL:.2f}; "
            f"concatenated ones have a higher share than the pignistic image alone (a) in {plain[0]}, in {plain[1]} at "
            "that level. Each setting has its own test, without a correction for their number, on the same pairs."
        )
    return sentences


def _wins(study: Study, first: str, other: str) -> tuple[int, int, int]:
    """Return the numbers of settings in which a modification is better, is significantly better, and of all."""
    higher = sure = total = 0
    for keypoints, ratio in dict.fromkeys((s.keypoints, s.ratio) for s in study.shares):
        mine, theirs = (study.shares[Setting(keypoints, ratio, letter)] for letter in (first, other))
        total += 1
        if _mean(mine) > _mean(theirs):
            higher += 1
            sure += paired_p_value(theirs, mine) <= 1.0 - LEVEL
    return higher, sure, total


def _near_paper(study: Study) -> str:
    """Return the number of means within 0.1 of the paper's, by modification."""
    rows = [row for row in dict.fromkeys((s.keypoints, s.ratio) for s in study.shares) if row in TABLE_2]
    near = {
        letter: sum(
            abs(_mean(study.shares[Setting(*row, letter)]) - table_2(*row).values[letter][0]) <= 0.1 for row in rows
        )
        for letter in MODIFICATIONS
    }
    return ", ".join(f"{letter} {count}" for letter, count in near.items()) + f" of {len(rows)}"


def curve_section(results: PaperResults, settings: PaperSettings) -> Section:
    """Figure 3."""
    names = {
        "as written: 128 bits, unknown as it is": results.studies[AS_WRITTEN],
        "as programmed: 256 bits, unknown inverted": results.studies[AS_PROGRAMMED],
    }
    caption = (
        f"Share of right matches over the number of keypoints (left) and Lowe's ratio (right), with {LEVEL:g} "
        "intervals of the mean by Student's t; the paper's from its deviations over ten pairs. A curve without points "
        "matched nothing."
    )
    png = draw_curves(names, settings.default_keypoints, settings.default_ratio)
    return Section("Figure 3: the share of right matches", [], pictures=[PaperPicture(png, caption, wide=True)])


_HEADS = ("keypoints", "ratio", *MODIFICATIONS, "best")


def _rows(study: Study) -> list[list[str]]:
    rows = []
    for keypoints, ratio in dict.fromkeys((s.keypoints, s.ratio) for s in study.shares):
        values = {letter: study.shares[Setting(keypoints, ratio, letter)] for letter in MODIFICATIONS}
        theirs = table_2(keypoints, ratio) if (keypoints, ratio) in TABLE_2 else None
        cells = [
            _spread(values[letter])
            + (f"\n{theirs.values[letter][0]:.2f} ± {theirs.values[letter][1]:.2f}" if theirs else "")
            for letter in MODIFICATIONS
        ]
        best = ", ".join(indistinguishable_from_best(values))
        rows.append([str(keypoints), f"{ratio:g}", *cells, best + (f"\n{', '.join(theirs.best)}" if theirs else "")])
    return rows


def _variants_table(results: PaperResults, settings: PaperSettings) -> Table:
    rows = []
    for variant, study in results.studies.items():
        cells = []
        for letter in MODIFICATIONS:
            setting = Setting(settings.default_keypoints, settings.default_ratio, letter)
            cells.append(f"{_spread(study.shares[setting])}\n{study.matches[setting].mean():.0f} matches")
        rows.append([f"{variant.bits} bits", variant.unknown, *cells])
    title = f"Variants at {settings.default_keypoints} keypoints and ratio {settings.default_ratio:g}"
    return Table(title, ("an image", "unknown", *MODIFICATIONS), rows)


def _variant_texts(results: PaperResults, settings: PaperSettings) -> Sequence[str]:
    def shares(variant: Variant, letter: str) -> FloatArray:
        return results.studies[variant].shares[Setting(settings.default_keypoints, settings.default_ratio, letter)]

    longer = _compared(shares(AS_WRITTEN, "b"), shares(Variant(256, "as it is"), "b"))
    inverted = _compared(shares(AS_WRITTEN, "b"), shares(Variant(128, "inverted"), "b"))
    gain = _compared(shares(AS_WRITTEN, "a"), shares(AS_WRITTEN, "b"))
    return [
        (
            f"Does concatenation help? From a to b {gain}. With 256 instead of 128 bits an image, b goes {longer}; "
            f"with the unknown image inverted, {inverted}."
        ),
        (
            "Why do c and d depend on the inversion? ORB's bits compare two pixels. Nearly everywhere the unknown mass "
            "is high where the free mass is low. As the paper is written, corresponding bits of both images are then "
            "opposite: their conjunction is 0 and their disjunction is 1 almost everywhere. No match passes the ratio "
            "test under 'and', and the matches under 'or' are mostly chance. With the inversion of the program, the "
            "images agree, and c and d work. Bit-wise joins always lose information: they keep fewer matches than "
            "concatenation."
        ),
        "Number of values within 0.1 of the paper's, in the rows of the paper: "
        + "; ".join(f"{name}: {_near_paper(results.studies[variant])}" for name, variant in _READINGS.items())
        + ".",
    ]


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
