"""Fusion of the masses of several sources, cell by cell and source by source, for each rule.

In this file masses are a tuple (conflict, free, occupied, unknown). The state ``kept`` of a cell depends on the rule.
Most rules keep four masses. Dubois and Prade's rule also keeps the disjunction (4) and the products of the masses on
free and on occupied (2). The rules without masses keep the belief of one source (4) and two numbers.
"""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel, part

DISJUNCTIVE, CONJUNCTIVE, DEMPSTER, DUBOIS_PRADE, YAGER, AVERAGE, UNANIMOUS, LOG_ODDS, ENTROPY_FILTER = range(9)

_SUREST = 0.998
"""Largest difference of two probabilities, 0.999 and 0.001: the log odds of certainty are infinite."""

Belief = tuple[float, float, float, float]
Cells = npt.NDArray[np.float32]
Counts = npt.NDArray[np.uint16]


@kernel
def add_layer(rule: int, masses: Cells, trust: float, kept: Cells, agreed: Cells, seen_by: Counts) -> None:
    """Add the ``masses`` (rows, cols, 4) of a source, discounted by ``trust``, in the cells that it observed.

    This updates the state ``kept`` (rows, cols, width), the conjunction ``agreed`` (rows, cols, 4) of all conflict-free
    sources, and the number ``seen_by`` (rows, cols) of sources.
    """
    for row in range(masses.shape[0]):
        for col in range(masses.shape[1]):
            if not masses[row, col, 3] < 1.0:
                continue
            belief = _believed(_read(masses, row, col, 0), trust)
            peaceful = _normalised(belief)
            if seen_by[row, col] == 0:
                _start(rule, belief, kept, row, col)
                _store(agreed, row, col, 0, peaceful)
            else:
                _add(rule, belief, kept, row, col)
                _store(agreed, row, col, 0, _conjunction(_read(agreed, row, col, 0), peaceful))
            seen_by[row, col] += 1


@kernel
def finish(
    rule: int, kept: Cells, agreed: Cells, seen_by: Counts, required: int, fused: Cells, conflict: Cells
) -> None:
    """Write the masses of the state ``kept`` into ``fused``, and the mass of ``agreed`` on conflict into ``conflict``.

    Cells observed by fewer than ``required`` sources become unknown. Cells observed by fewer than two sources have no
    conflict. ``fused`` (rows, cols, 4) may be the array ``kept`` itself.
    """
    for row in range(kept.shape[0]):
        for col in range(kept.shape[1]):
            count = seen_by[row, col]
            conflict[row, col] = agreed[row, col, 0] if count > 1 else 0.0
            if count < max(required, 1):
                _store(fused, row, col, 0, (0.0, 0.0, 0.0, 1.0))
            else:
                _store(fused, row, col, 0, _finished(rule, kept, row, col, count))


@part
def _start(rule: int, belief: Belief, kept: Cells, row: int, col: int) -> None:
    _store(kept, row, col, 0, belief)
    if rule == DUBOIS_PRADE:
        _store(kept, row, col, 4, belief)
        kept[row, col, 8], kept[row, col, 9] = belief[1], belief[2]
    elif rule == UNANIMOUS:
        kept[row, col, 4] = 1.0 if belief[1] > belief[2] else 0.0
        kept[row, col, 5] = 1.0 if belief[2] > belief[1] else 0.0
    elif rule >= LOG_ODDS:  # a set of rules would be built for every cell
        kept[row, col, 4] = kept[row, col, 5] = _log_odds(belief)


@part
def _add(rule: int, belief: Belief, kept: Cells, row: int, col: int) -> None:
    if rule >= UNANIMOUS:
        _add_evidence(rule, belief, kept, row, col)
        return
    before = _read(kept, row, col, 0)
    if rule == AVERAGE:
        after = (before[0] + belief[0], before[1] + belief[1], before[2] + belief[2], before[3] + belief[3])
    elif rule == DISJUNCTIVE:
        # The associative rules multiply the sums of masses, so rounding errors would grow with the number of maps.
        after = _rescaled(_disjunction(before, belief))
    elif rule == DEMPSTER:
        after = _normalised(_conjunction(before, belief))
    elif rule == CONJUNCTIVE:
        after = _rescaled(_conjunction(before, belief))
    else:
        after = _conjunction(before, belief)
        if rule == DUBOIS_PRADE:
            _store(kept, row, col, 4, _disjunction(_read(kept, row, col, 4), belief))
            kept[row, col, 8] *= belief[1]
            kept[row, col, 9] *= belief[2]
    _store(kept, row, col, 0, after)


@part
def _add_evidence(rule: int, belief: Belief, kept: Cells, row: int, col: int) -> None:
    if rule == UNANIMOUS:
        if kept[row, col, 4] + kept[row, col, 5] == 0.0:  # earlier sources may be undecided
            _store(kept, row, col, 0, belief)
        kept[row, col, 4] += 1.0 if belief[1] > belief[2] else 0.0
        kept[row, col, 5] += 1.0 if belief[2] > belief[1] else 0.0
        return
    odds = np.float32(_log_odds(belief))  # as precise as what is kept, so that equal odds are equal
    surest = kept[row, col, 5]
    kept[row, col, 4] += odds
    # The result must not depend on the order of two equally certain sources.
    if abs(odds) > abs(surest) or (abs(odds) == abs(surest) and odds < surest):
        kept[row, col, 5] = odds


@part
def _finished(rule: int, kept: Cells, row: int, col: int, count: int) -> Belief:
    m = _read(kept, row, col, 0)
    if rule == UNANIMOUS and kept[row, col, 4] + kept[row, col, 5] == 1.0:
        return m  # of the only decided source
    if rule >= UNANIMOUS:
        return m if count < 2 else _weighed(rule, kept[row, col, 4], kept[row, col, 5])
    if rule == AVERAGE:
        return (m[0] / count, m[1] / count, m[2] / count, m[3] / count)
    if rule == YAGER:
        return (0.0, m[1], m[2], m[3] + m[0])
    if rule == DUBOIS_PRADE:
        # A set receives the products with this intersection, and the products with an empty intersection and this
        # union. Of the products with union {free}, only the product of all masses on {free} has a nonempty
        # intersection.
        either = _read(kept, row, col, 4)
        all_free, all_occupied = float(kept[row, col, 8]), float(kept[row, col, 9])
        mixed = m[1] - all_free + m[2] - all_occupied  # intersection {free} or {occupied}, union unknown
        return (
            max(either[0], 0.0),
            max(m[1] + either[1] - all_free, 0.0),
            max(m[2] + either[2] - all_occupied, 0.0),
            max(either[3] - mixed, 0.0),
        )
    return m


@part
def _weighed(rule: int, first: float, second: float) -> Belief:
    """Return the belief for the two numbers of a rule without masses."""
    if rule == UNANIMOUS:
        lean = 1.0 if first == 0.0 and second > 0.0 else (-1.0 if second == 0.0 and first > 0.0 else 0.0)
    elif rule == ENTROPY_FILTER and abs(first) < abs(second):
        lean = math.tanh(second / 2.0)
    else:
        lean = math.tanh(first / 2.0)
    return (0.0, max(-lean, 0.0), max(lean, 0.0), 1.0 - abs(lean))


@part
def _log_odds(m: Belief) -> float:
    """Return the log odds of being occupied; with P the pignistic probability, atanh(2 P - 1) is half of them."""
    rest = m[1] + m[2] + m[3]
    lean = (m[2] - m[1]) / rest if rest > 0.0 else 0.0
    return 2.0 * math.atanh(min(max(lean, -_SUREST), _SUREST))


@part
def _believed(m: Belief, trust: float) -> Belief:
    if trust == 1.0:
        return m
    doubt = (1.0 - trust) * (m[0] + m[1] + m[2] + m[3])
    return (m[0] * trust, m[1] * trust, m[2] * trust, m[3] * trust + doubt)


@part
def _conjunction(a: Belief, b: Belief) -> Belief:
    peace = a[1] + a[2] + a[3]
    return (
        a[0] * (b[0] + b[1] + b[2] + b[3]) + peace * b[0] + a[1] * b[2] + a[2] * b[1],
        a[1] * (b[1] + b[3]) + a[3] * b[1],
        a[2] * (b[2] + b[3]) + a[3] * b[2],
        a[3] * b[3],
    )


@part
def _disjunction(a: Belief, b: Belief) -> Belief:
    certain = a[0] + a[1] + a[2]
    return (
        a[0] * b[0],
        a[1] * (b[1] + b[0]) + a[0] * b[1],
        a[2] * (b[2] + b[0]) + a[0] * b[2],
        a[3] * (b[0] + b[1] + b[2] + b[3]) + certain * b[3] + a[1] * b[2] + a[2] * b[1],
    )


@part
def _normalised(m: Belief) -> Belief:
    rest = m[1] + m[2] + m[3]
    if rest > 0.0:
        scale = 1.0 / rest
        return (0.0, m[1] * scale, m[2] * scale, m[3] * scale)
    return (0.0, 0.0, 0.0, 1.0)


@part
def _rescaled(m: Belief) -> Belief:
    scale = 1.0 / (m[0] + m[1] + m[2] + m[3])
    return (m[0] * scale, m[1] * scale, m[2] * scale, m[3] * scale)


@part
def _read(cells: Cells, row: int, col: int, first: int) -> Belief:
    # A view of the cell as argument would take most of the time, since numba counts references to views.
    return (
        float(cells[row, col, first]),
        float(cells[row, col, first + 1]),
        float(cells[row, col, first + 2]),
        float(cells[row, col, first + 3]),
    )


@part
def _store(cells: Cells, row: int, col: int, first: int, m: Belief) -> None:
    for subset in range(4):
        cells[row, col, first + subset] = m[subset]
