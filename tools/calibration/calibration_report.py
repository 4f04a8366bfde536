"""The calibration of a confidence as tables and as a plot."""

import io
import itertools
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from tools.calibration.trial import Judgement
from tools.command_line.text_table import text_table

BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0)
"""Edges of the bins of confidence."""

_THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9)


class Judged(Protocol):
    """An answer with a confidence."""

    @property
    def confidence(self) -> float:
        """The probability that the answer is right."""

    @property
    def right(self) -> bool:
        """Whether the answer is right."""


def acceptance_table(judged: Sequence[Judgement]) -> str:
    """Return a table of correctly accepted pairs by overlap, and of false accepts, for several thresholds."""
    crops = [item for item in judged if item.name.startswith("crop")]
    others = [item for item in judged if not item.name.startswith("crop")]
    overlaps = sorted({item.name[-3:] for item in crops}, reverse=True)
    rows = []
    for least in _THRESHOLDS:
        cells = []
        for overlap in overlaps:
            mine = [item for item in crops if item.name.endswith(overlap)]
            cells.append(f"{sum(one.right and one.confidence >= least for one in mine)}/{len(mine)}")
        wrong = sum(not item.right and item.confidence >= least for item in crops)
        false = sum(item.confidence >= least for item in others)
        rows.append([f"{least:.1f}", *cells, str(wrong), f"{false} of {len(others)}"])
    head = ["least confidence", *(f"{int(overlap)} %" for overlap in overlaps), "wrong", "negatives"]
    return text_table(head, rows)


def _bins(judged: Sequence[Judged], edges: Sequence[float]) -> Iterator[tuple[float, float, float, int, int]]:
    """Yield the bounds and the mean of confidence, the right answers and all answers of each bin that has any."""
    for low, high in itertools.pairwise(edges):
        inside = [item for item in judged if low <= item.confidence < high or high == item.confidence == edges[-1]]
        if inside:
            given = float(np.mean([item.confidence for item in inside]))
            yield low, high, given, sum(item.right for item in inside), len(inside)


def calibration_table(judged: Sequence[Judged], edges: Sequence[float]) -> str:
    """Return a table of the share of right answers in bins of confidence."""
    rows = [
        [f"{low:.2f} to {high:.2f}", str(pairs), f"{given:.3f}", f"{right / pairs:.3f}"]
        for low, high, given, right, pairs in _bins(judged, edges)
    ]
    return text_table(["confidence", "pairs", "given, mean", "right, share"], rows)


def draw_calibration(judged: Sequence[Judged], edges: Sequence[float]) -> bytes:
    """Return a PNG with a dot for each bin of confidence: its share of right answers with the 95 % interval."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 5.0), layout="constrained")
    from scipy.stats import binomtest  # takes half a second, in each process that only collects

    panel = figure.subplots()
    panel.plot((0.0, 1.0), (0.0, 1.0), color="#bebebe", linewidth=1.0)
    for _, _, given, right, pairs in _bins(judged, edges):
        share, interval = right / pairs, binomtest(right, pairs).proportion_ci(method="wilson")
        beyond = [[share - interval.low], [interval.high - share]]
        panel.errorbar(given, share, yerr=beyond, color="#0072B2", marker="o", capsize=2)
        panel.annotate(str(pairs), (given, share), xytext=(6, -12), textcoords="offset points")
    panel.set(xlabel="confidence given", ylabel="share that is right", xlim=(-0.03, 1.08), ylim=(-0.03, 1.03))
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()
