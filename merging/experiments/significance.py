"""Significance of differences between methods on the same pairs."""

from collections.abc import Mapping

import numpy as np
from scipy import stats

from tbmslam.geometry.se2 import FloatArray

LEVEL = 0.95
TEST = (
    "Exact two-sided permutation test of the mean paired difference (every sign of every pair's difference; Fisher, "
    "Pitman), each method against the best one, corrected by Holm for their number"
)
_MOST_PAIRS = 16


def paired_p_value(first: FloatArray, second: FloatArray) -> float:
    """Return the probability that equally good methods differ at least as much on the same pairs (P,).

    Pairs where either has no value are left out; without any difference it is 1.

    Raises
    ------
    ValueError
        There are too many pairs to test all signs.
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


def indistinguishable_from_best(values: Mapping[str, FloatArray], level: float = LEVEL) -> list[str]:
    """Return the methods of which none is significantly worse than the best: the paper's column 4.

    Parameters
    ----------
    values
        What each method reached on the same pairs (P,); nan for none.
    level
        Confidence level.
    """
    means = {name: float(np.nanmean(v)) for name, v in values.items() if np.isfinite(v).any()}
    if not means:
        return []
    best = max(means, key=lambda name: means[name])
    others = [name for name in means if name != best]
    p_values = {name: paired_p_value(values[best], values[name]) for name in others}
    worse = _rejected(p_values, 1.0 - level)
    return [name for name in values if name in means and name not in worse]


def half_interval(values: FloatArray, level: float = LEVEL) -> float:
    """Return half the width of the confidence interval of the mean of values (P,), by Student's t; nan for one."""
    finite = values[np.isfinite(values)]
    if len(finite) < 2:
        return float("nan")
    return half_width(float(finite.std(ddof=1)), len(finite), level)


def half_width(deviation: float, count: int, level: float = LEVEL) -> float:
    """Return half the width of the confidence interval of the mean of `count` values with a standard deviation."""
    return float(stats.t.ppf(0.5 + level / 2.0, count - 1)) * deviation / float(np.sqrt(count))


def _rejected(p_values: Mapping[str, float], alpha: float) -> set[str]:
    """Return the hypotheses that Holm's procedure rejects (1979)."""
    rejected: set[str] = set()
    for rank, name in enumerate(sorted(p_values, key=lambda name: p_values[name])):
        if p_values[name] > alpha / (len(p_values) - rank):
            break
        rejected.add(name)
    return rejected
