"""The paper's own numbers, and the significance of differences between methods on the same pairs.

M. Dobrokhvalov, A. Filatov, "Merging occupancy grid map based on Transferable Belief Model", SEIM 2021.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import stats

from tbmslam.geometry.se2 import FloatArray

TABLE_1: Mapping[str, tuple[float, ...]] = {
    "ORB": (0.958, 1.0, 0.714, 0.993, 0.96, 0.999, 0.999),
    "BRISK": (0.889, 1.0, 0.5, 1.0, 0.818, 1.0, 0.998),
    "SIFT": (0.25, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0),
    "SURF": (0.0, 0.951, 0.0, 1.0, 0.0, 1.0, 0.996),
}
"""Share of right matches in seven pairs, by detector."""

TABLE_2: Mapping[tuple[int, float], str] = {
    (100, 0.5): "0.53 0.10 0.55 0.08 0.52 0.15 0.34 0.09 0.32 0.10 abc",
    (100, 0.6): "0.53 0.11 0.74 0.04 0.67 0.02 0.52 0.08 0.38 0.10 b",
    (100, 0.7): "0.52 0.15 0.75 0.03 0.52 0.01 0.56 0.07 0.50 0.15 b",
    (100, 0.8): "0.62 0.02 0.78 0.02 0.35 0.02 0.55 0.02 0.58 0.09 b",
    (500, 0.5): "0.75 0.09 0.76 0.04 0.49 0.08 0.63 0.11 0.42 0.13 ab",
    (500, 0.6): "0.70 0.11 0.77 0.04 0.43 0.03 0.56 0.05 0.56 0.10 ab",
    (500, 0.7): "0.82 0.03 0.84 0.01 0.31 0.01 0.35 0.01 0.64 0.06 ab",
    (500, 0.8): "0.66 0.03 0.65 0.04 0.18 0.01 0.23 0.01 0.39 0.02 ab",
    (1000, 0.5): "0.61 0.13 0.62 0.09 0.32 0.06 0.48 0.09 0.49 0.12 ab",
    (1000, 0.6): "0.72 0.11 0.77 0.03 0.45 0.02 0.45 0.05 0.65 0.10 ab",
    (1000, 0.7): "0.74 0.02 0.83 0.03 0.50 0.06 0.49 0.14 0.22 0.05 b",
    (1000, 0.8): "0.59 0.04 0.68 0.03 0.19 0.00 0.16 0.00 0.33 0.03 b",
    (2500, 0.5): "0.69 0.11 0.63 0.11 0.28 0.03 0.57 0.08 0.26 0.10 a",
    (2500, 0.6): "0.76 0.07 0.78 0.02 0.30 0.01 0.40 0.04 0.62 0.02 ab",
    (2500, 0.7): "0.70 0.03 0.85 0.01 0.33 0.05 0.32 0.03 0.40 0.02 b",
    (2500, 0.8): "0.54 0.06 0.58 0.05 0.30 0.10 0.16 0.01 0.24 0.02 ab",
    (5000, 0.5): "0.69 0.09 0.90 0.03 0.18 0.03 0.31 0.06 0.49 0.09 b",
    (5000, 0.6): "0.83 0.01 0.83 0.03 0.21 0.03 0.26 0.03 0.48 0.03 ab",
    (5000, 0.7): "0.62 0.06 0.65 0.05 0.25 0.06 0.27 0.02 0.23 0.02 ab",
    (5000, 0.8): "0.49 0.07 0.51 0.06 0.26 0.02 0.17 0.01 0.23 0.01 ab",
}
"""Mean and deviation of the share of right matches for the modifications a to e, and the best ones, by the number of
keypoints and Lowe's ratio."""

TABLE_3: tuple[tuple[float, float, float], ...] = (
    (0.031, 16.043, 0.158),
    (0.000, 0.000, 0.000),
    (0.028, 0.707, 0.138),
    (0.012, 18.058, 0.330),
    (0.029, 30.904, 0.256),
    (0.017, 0.854, 0.098),
    (0.006, 26.217, 0.121),
    (0.011, 22.701, 0.104),
    (0.004, 33.530, 0.305),
)
"""Minimum, maximum and geometric mean of the distances between matches after the transform [m], in nine pairs."""

TABLE_4: tuple[tuple[float, float, float], ...] = (
    (8700, 971.5, 98.142),
    (12100, 1395.9, 117.230),
    (13200, 1501.4, 146.242),
    (4125, 446.4, 24.707),
    (4900, 598.5, 48.028),
    (5625, 692.3, 70.477),
    (12100, 1420.9, 96.175),
    (12075, 1370.3, 101.308),
    (12100, 1365.5, 115.612),
)
"""Area of the merged map [m^2], mean and deviation of the time, which the paper gives in seconds, in nine pairs."""


class PublishedRow(NamedTuple):
    """A row of table II: mean and deviation of each modification, and the best modifications."""

    values: Mapping[str, tuple[float, float]]
    best: str


def table_2(keypoints: int, ratio: float) -> PublishedRow:
    """Return a row of table II."""
    if (keypoints, ratio) not in TABLE_2:
        raise ValueError(f"table II has no row of {keypoints} keypoints at ratio {ratio}")
    *numbers, best = TABLE_2[keypoints, ratio].split()
    values = [float(number) for number in numbers]
    return PublishedRow({letter: (values[2 * i], values[2 * i + 1]) for i, letter in enumerate("abcde")}, best)


LEVEL = 0.95
TEST = (
    "Exact two-sided permutation test of the mean paired difference (every sign of every pair's difference; Fisher, "
    "Pitman), each method against the best one, corrected by Holm for their number"
)
_MOST_PAIRS = 16


def paired_p_value(first: FloatArray, second: FloatArray) -> float:
    """Return the probability that equally good methods differ at least as much on the same pairs (P,).

    Pairs where either has no value are left out; without any difference it is 1.
    """
    differences = first - second
    differences = differences[np.isfinite(differences)]
    if len(differences) > _MOST_PAIRS:
        raise ValueError(f"pairs must be {_MOST_PAIRS} at most, got {len(differences)}")
    if not differences.any():
        return 1.0
    signs = 1 - 2 * (np.arange(2 ** len(differences))[:, None] >> np.arange(len(differences)) & 1)
    sums = np.abs(signs @ differences)
    return float(np.mean(sums >= abs(differences.sum()) * (1.0 - 1e-9)))


def indistinguishable_from_best(values: Mapping[str, FloatArray]) -> list[str]:
    """Return the methods that are not significantly worse than the best: the paper's column 4.

    `values` are the results (P,) of each method for the same pairs; nan for none.
    """
    means = {name: float(np.nanmean(v)) for name, v in values.items() if np.isfinite(v).any()}
    if not means:
        return []
    best = max(means, key=lambda name: means[name])
    others = [name for name in means if name != best]
    p_values = {name: paired_p_value(values[best], values[name]) for name in others}
    worse = _rejected(p_values, 1.0 - LEVEL)
    return [name for name in values if name in means and name not in worse]


def half_interval(values: FloatArray) -> float:
    """Return half the width of the confidence interval of the mean of values (P,), by Student's t; nan for one."""
    finite = values[np.isfinite(values)]
    if len(finite) < 2:
        return float("nan")
    return half_width(float(finite.std(ddof=1)), len(finite))


def half_width(deviation: float, count: int) -> float:
    """Return half the width of the confidence interval of the mean of `count` values with a standard deviation."""
    return float(stats.t.ppf(0.5 + LEVEL / 2.0, count - 1)) * deviation / float(np.sqrt(count))


def _rejected(p_values: Mapping[str, float], alpha: float) -> set[str]:
    """Return the hypotheses that Holm's procedure rejects (1979)."""
    rejected: set[str] = set()
    for rank, name in enumerate(sorted(p_values, key=lambda name: p_values[name])):
        if p_values[name] > alpha / (len(p_values) - rank):
            break
        rejected.add(name)
    return rejected
