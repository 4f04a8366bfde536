"""Calibration of the confidence, as a table and as a plot."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from tbmslam.io.pictures import encode_png
from tools.command_line.text_table import text_table

BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 1.0)
"""Edges of the confidences that are put together."""

_THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Judgement:
    """What a model says of a pair: its best place's confidence, and whether that place is the true one.

    Parameters
    ----------
    name
        The pair.
    confidence
        Of its likeliest place; 0 where there is none.
    right
        Whether that is the truth.
    """

    name: str
    confidence: float
    right: bool


class Judged(Protocol):
    """Anything with a confidence that was right or wrong."""

    @property
    def confidence(self) -> float:
        """What was promised."""

    @property
    def right(self) -> bool:
        """What came of it."""


def worth(judged: Sequence[Judgement]) -> str:
    """Return a table of what is accepted rightly, by overlap, and wrongly, at several least confidences."""
    crops = [one for one in judged if one.name.startswith("crop")]
    others = [one for one in judged if not one.name.startswith("crop")]
    overlaps = sorted({one.name[-3:] for one in crops}, reverse=True)
    rows = []
    for least in _THRESHOLDS:
        cells = []
        for overlap in overlaps:
            mine = [one for one in crops if one.name.endswith(overlap)]
            cells.append(f"{sum(one.right and one.confidence >= least for one in mine)}/{len(mine)}")
        wrong = sum(not one.right and one.confidence >= least for one in crops)
        false = sum(one.confidence >= least for one in others)
        rows.append([f"{least:.1f}", *cells, str(wrong), f"{false} of {len(others)}"])
    head = ["least confidence", *(f"{int(overlap)} %" for overlap in overlaps), "wrong", "negatives"]
    return text_table(head, rows)


def calibration_table(judged: Sequence[Judged], edges: Sequence[float]) -> str:
    """Return how many of the best places are right, by the confidence that they were given, in bins."""
    rows = []
    for low, high in itertools.pairwise(edges):
        inside = [one for one in judged if low <= one.confidence < high or high == one.confidence == edges[-1]]
        if inside:
            given = float(np.mean([one.confidence for one in inside]))
            share = sum(one.right for one in inside) / len(inside)
            rows.append([f"{low:.2f} to {high:.2f}", str(len(inside)), f"{given:.3f}", f"{share:.3f}"])
    return text_table(["confidence", "pairs", "given, mean", "right, share"], rows)


_SIZE, _MARGIN = 480, 60
_BLACK, _GREY, _BLUE = (0, 0, 0), (190, 190, 190), (178, 114, 0)


def draw_calibration(judged: Sequence[tuple[float, bool]], edges: Sequence[float]) -> bytes:
    """Return a PNG: the diagonal, and for each bin of confidence a dot with the 95 % interval of the share right.

    Parameters
    ----------
    judged
        Confidence, and whether the answer was right.
    edges
        Of the bins, rising from 0 to 1.
    """
    picture = np.full((_SIZE + 2 * _MARGIN, _SIZE + 2 * _MARGIN, 3), 255, dtype=np.uint8)
    cv2.rectangle(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _BLACK, 1)
    cv2.line(picture, _pixel(0.0, 0.0), _pixel(1.0, 1.0), _GREY, 1, cv2.LINE_AA)
    for tick in (0.0, 0.5, 1.0):
        _write(picture, f"{tick:g}", (_pixel(tick, 0.0)[0] - 8, _SIZE + _MARGIN + 22))
        _write(picture, f"{tick:g}", (_MARGIN - 38, _pixel(0.0, tick)[1] + 5))
    _write(picture, "confidence given", (_MARGIN + _SIZE // 2 - 70, _SIZE + _MARGIN + 45))
    _write(picture, "share that is right", (_MARGIN, _MARGIN - 15))
    for low, high in itertools.pairwise(edges):
        inside = [(p, right) for p, right in judged if low <= p < high or (high == edges[-1] and p == high)]
        if inside:
            given = float(np.mean([p for p, _ in inside]))
            share, least, most = _wilson(sum(right for _, right in inside), len(inside))
            cv2.line(picture, _pixel(given, least), _pixel(given, most), _BLUE, 1, cv2.LINE_AA)
            cv2.circle(picture, _pixel(given, share), 5, _BLUE, -1, cv2.LINE_AA)
            _write(picture, str(len(inside)), (_pixel(given, share)[0] + 8, _pixel(given, share)[1] + 14))
    return encode_png(picture)


def _wilson(right: int, count: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Wilson 1927)."""
    share, z = right / count, 1.96
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    reach = z * float(np.sqrt(share * (1 - share) / count + z * z / (4 * count * count))) / (1 + z * z / count)
    return share, max(middle - reach, 0.0), min(middle + reach, 1.0)


def _pixel(x: float, y: float) -> tuple[int, int]:
    return round(_MARGIN + x * _SIZE), round(_MARGIN + (1.0 - y) * _SIZE)


def _write(picture: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _BLACK, 1, cv2.LINE_AA)
