import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from merging.fusion import RULES
from tbmslam.belief.masses import pignistic
from tbmslam.kernels.grids.fusion import add_layer, finish
from tests.belief_rules import discount, normalise

FREE, OCCUPIED, UNKNOWN = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)

beliefs = st.lists(
    arrays(np.float64, 4, elements=st.floats(0.01, 1.0)).map(lambda masses: masses / masses.sum()),
    min_size=2,
    max_size=4,
)


def fused(rule, *sources, trusts=None, required=1):
    """One cell by the kernel: its fused masses and its conflict."""
    how = RULES[rule]
    kept, agreed = np.empty((1, 1, how.width), dtype=np.float32), np.empty((1, 1, 4), dtype=np.float32)
    seen_by = np.zeros((1, 1), dtype=np.uint16)
    for source, trust in zip(sources, trusts or [1.0] * len(sources), strict=True):
        add_layer(how.code, np.array(source, dtype=np.float32).reshape(1, 1, 4), trust, kept, agreed, seen_by)
    masses, conflict = np.empty((1, 1, 4), dtype=np.float32), np.empty((1, 1), dtype=np.float32)
    finish(how.code, kept, agreed, seen_by, required, masses, conflict)
    return masses[0, 0], conflict[0, 0]


def by_probability(rule, sources):
    """The rules that know probabilities only."""
    probabilities = np.clip([pignistic(source) for source in sources], 0.001, 0.999)
    if rule == "unanimous":
        taken = [source for source in sources if np.float32(source[1]) != np.float32(source[2])]
        if len(taken) == 1:
            return np.array(taken[0])
        states = {np.sign(source[2] - source[1]) for source in taken}
        return {frozenset({1.0}): OCCUPIED, frozenset({-1.0}): FREE}.get(frozenset(states), UNKNOWN)
    odds = np.prod(probabilities / (1.0 - probabilities))
    merged = odds / (1.0 + odds)
    if rule == "entropy-filter":
        candidates = [merged, *probabilities]
        surest = max(candidates, key=lambda p: abs(np.log(p / (1.0 - p))))
        merged = merged if abs(np.log(odds)) >= abs(np.log(surest / (1.0 - surest))) else surest
    lean = 2.0 * merged - 1.0
    return np.array([0.0, max(-lean, 0.0), max(lean, 0.0), 1.0 - abs(lean)])


def by_definition(rule, sources):
    """Every choice of one subset from each source, and where its product goes."""
    if rule == "average":
        return np.mean(sources, axis=0)
    if rule in {"unanimous", "log-odds", "entropy-filter"}:
        return by_probability(rule, sources)
    total = np.zeros(4)
    for subsets in itertools.product(range(4), repeat=len(sources)):
        common, union = 3, 0
        for subset in subsets:
            common, union = common & subset, union | subset
        goes_to = {"disjunctive": union, "dubois-prade": common or union, "yager": common or 3}.get(rule, common)
        total[goes_to] += math.prod(source[subset] for source, subset in zip(sources, subsets, strict=True))
    return normalise(total) if rule == "dempster" else total


@pytest.mark.parametrize("rule", RULES)
@given(sources=beliefs)
def test_rules_are_those_of_their_definition(rule, sources):
    masses, conflict = fused(rule, *sources)
    np.testing.assert_allclose(masses, by_definition(rule, sources), atol=1e-5 if rule.startswith("log") else 1e-6)
    assert conflict == pytest.approx(by_definition("conjunctive", [normalise(one) for one in sources])[0], abs=1e-6)


@pytest.mark.parametrize("rule", RULES)
@given(sources=beliefs)
def test_any_order_gives_the_same_belief(rule, sources):
    forth, back = fused(rule, *sources)[0], fused(rule, *sources[::-1])[0]
    np.testing.assert_allclose(forth, back, atol=1e-6)
    assert forth.sum() == pytest.approx(1.0, abs=1e-6)
    assert forth.min() >= 0.0


def test_either_order_of_two_equally_sure_contradictions_gives_the_same_belief():
    free, occupied = (0.0, 0.9, 0.0, 0.1), (0.0, 0.0, 0.9, 0.1)
    forth, back = fused("entropy-filter", free, occupied)[0], fused("entropy-filter", occupied, free)[0]
    np.testing.assert_array_equal(forth, back)


@given(sources=beliefs, trust=st.floats(0.0, 1.0))
def test_a_source_is_discounted_as_the_algebra_says(sources, trust):
    weakened = [sources[0], *(discount(source, trust) for source in sources[1:])]
    expected = fused("conjunctive", *weakened)[0]
    trusts = [1.0, *[trust] * (len(sources) - 1)]
    np.testing.assert_allclose(fused("conjunctive", *sources, trusts=trusts)[0], expected, atol=1e-6)


@pytest.mark.parametrize(
    ("rule", "contradiction"),
    [
        ("dubois-prade", UNKNOWN),
        ("yager", UNKNOWN),
        ("average", (0.0, 0.5, 0.5, 0.0)),
        ("disjunctive", UNKNOWN),
        ("conjunctive", (1.0, 0.0, 0.0, 0.0)),
        ("dempster", UNKNOWN),
        ("unanimous", UNKNOWN),
        ("log-odds", UNKNOWN),
        ("entropy-filter", (0.0, 0.998, 0.0, 0.002)),
    ],
)
def test_what_becomes_of_a_contradiction(rule, contradiction):
    masses, conflict = fused(rule, FREE, OCCUPIED)
    np.testing.assert_allclose(masses, contradiction, atol=1e-6)
    assert conflict == 1.0


def test_agreement_sharpens_under_dubois_and_prade():
    half = (0.0, 0.5, 0.0, 0.5)
    np.testing.assert_allclose(fused("dubois-prade", half, half)[0], (0.0, 0.75, 0.0, 0.25))


def test_the_entropy_filter_rejects_what_would_make_a_cell_less_certain():
    sure, doubting, agreeing = (0.0, 0.8, 0.0, 0.2), (0.0, 0.0, 0.5, 0.5), (0.0, 0.5, 0.0, 0.5)
    np.testing.assert_allclose(fused("entropy-filter", sure, doubting)[0], sure, atol=1e-6)
    assert fused("log-odds", sure, doubting)[0][1] == pytest.approx(0.5)  # odds of 9 and 1/3 make 3
    agreed = fused("entropy-filter", sure, agreeing)[0]
    np.testing.assert_allclose(agreed, fused("log-odds", sure, agreeing)[0])
    assert agreed[1] > 0.9


def test_one_dissenter_makes_a_cell_unknown():
    weak, undecided = (0.0, 0.3, 0.0, 0.7), (0.0, 0.3, 0.3, 0.4)
    np.testing.assert_array_equal(fused("unanimous", FREE, weak, undecided)[0], FREE)
    np.testing.assert_array_equal(fused("unanimous", FREE, weak, OCCUPIED)[0], UNKNOWN)


@pytest.mark.parametrize("rule", RULES)
def test_who_saw_nothing_says_nothing(rule):
    np.testing.assert_array_equal(fused(rule, UNKNOWN, FREE)[0], FREE)
    np.testing.assert_array_equal(fused(rule, UNKNOWN, UNKNOWN)[0], UNKNOWN)
    np.testing.assert_array_equal(fused(rule, UNKNOWN, FREE, required=2)[0], UNKNOWN)
    assert fused(rule, UNKNOWN, FREE)[1] == 0.0
