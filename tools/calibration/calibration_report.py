"""The calibration of a confidence as tables and as a plot."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Protocol

import cv2
import numpy as np
from scipy.stats import binomtest

from tbmslam.io.pictures import encode_png
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


_SIZE, _MARGIN = 480, 60
_BLACK, _GREY, _BLUE = (0, 0, 0), (190, 190, 190), (178, 114, 0)


def draw_calibration(judged: Sequence[Judged], edges: Sequence[float]) -> bytes:
    """Return a PNG with a dot for each bin of confidence: its share of right answers with the 95 % interval."""
    picture = np.full((_SIZE + 2 * _MARGIN, _SIZE + 2 * _MARGIN, 3), 255, dtype=np.uint8)
    cv2.rectangle(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _BLACK, 1)
    cv2.line(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _GREY, 1, cv2.LINE_AA)
    for tick in (0.0, 0.5, 1.0):
        _write(picture, f"{tick:g}", (_pixel(tick, 0.0)[0] - 8, _SIZE + _MARGIN + 22))
        _write(picture, f"{tick:g}", (_MARGIN - 38, _pixel(0.0, tick)[1] + 5))
    _write(picture, "confidence given", (_MARGIN + _SIZE // 2 - 70, _SIZE + _MARGIN + 45))
    _write(picture, "share that is right", (_MARGIN, _MARGIN - 15))
    for _, _, given, right, pairs in _bins(judged, edges):
        interval = binomtest(right, pairs).proportion_ci(method="wilson")
        x, y = _pixel(given, right / pairs)
        cv2.line(picture, _pixel(given, interval.low), _pixel(given, interval.high), _BLUE, 1, cv2.LINE_AA)
        cv2.circle(picture, (x, y), 5, _BLUE, -1, cv2.LINE_AA)
        _write(picture, str(pairs), (x + 8, y + 14))
    return encode_png(picture)


def _pixel(x: float, y: float) -> tuple[int, int]:
    return round(_MARGIN + x * _SIZE), round(_MARGIN + (1.0 - y) * _SIZE)


def _write(picture: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _BLACK, 1, cv2.LINE_AA)
