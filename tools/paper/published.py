"""The paper's own numbers, and the significance of differences between methods on the same pairs.

M. Dobrokhvalov, A. Filatov, "Merging occupancy grid map based on Transferable Belief Model", SEIM 2021.
"""

import json
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import NamedTuple

import numpy as np
from scipy import stats

from tbmslam.geometry.se2 import FloatArray


class PublishedRow(NamedTuple):
    """A row of table II: mean and deviation of each modification, and the best modifications."""

    values: Mapping[str, tuple[float, float]]
    best: str


_PUBLISHED = json.loads(resources.files(__package__).joinpath("published.json").read_text(encoding="utf-8"))
TABLE_1: Mapping[str, tuple[float, ...]] = {name: tuple(shares) for name, shares in _PUBLISHED["table_1"].items()}
"""Share of right matches in seven pairs, by detector."""
TABLE_2: Mapping[tuple[int, float], PublishedRow] = {
    (row["keypoints"], row["ratio"]): PublishedRow({letter: tuple(row[letter]) for letter in "abcde"}, row["best"])
    for row in _PUBLISHED["table_2"]
}
"""Shares of right matches by the number of keypoints and Lowe's ratio."""
TABLE_3: Sequence[Sequence[float]] = _PUBLISHED["table_3"]
"""Minimum, maximum and geometric mean of the distances between matches after the transform [m], in nine pairs."""
TABLE_4: Sequence[Sequence[float]] = _PUBLISHED["table_4"]
"""Area of the merged map [m^2], mean and deviation of the time, which the paper gives in seconds, in nine pairs."""

LEVEL = 0.95
TEST = (
    "Exact two-sided permutation test of the mean paired difference (every sign of every pair's difference; Fisher, "
    "Pitman), each method against the best one, corrected by Holm for their number"
)
_MOST_PAIRS = 16


def paired_p_value(first: FloatArray, second: FloatArray) -> float:
    """Return the probability that equally good methods differ at least as much on the same pairs (P,).

    Pairs where either has no value are left out; without any difference, or for one pair, it is 1.
    """
    differences = first - second
    differences = differences[np.isfinite(differences)]
    if len(differences) > _MOST_PAIRS:
        raise ValueError(f"pairs must be {_MOST_PAIRS} at most, got {len(differences)}")
    if len(differences) < 2 or not differences.any():
        return 1.0
    found = stats.permutation_test((differences,), np.sum, permutation_type="samples", n_resamples=2**_MOST_PAIRS)
    return float(found.pvalue)


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
