"""What a confidence is worth: how many answers are right, by what was promised."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

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
