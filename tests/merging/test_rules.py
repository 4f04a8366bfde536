import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from merging.rules import RULES

FREE, OCCUPIED, UNKNOWN = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)

beliefs = st.lists(
    arrays(np.float64, 4, elements=st.floats(0.01, 1.0)).map(lambda masses: masses / masses.sum()),
    min_size=2,
    max_size=4,
)


def fused(rule, *sources):
    how = RULES[rule]
    kept = how.start(np.array([sources[0]], dtype=np.float64))
    for source in sources[1:]:
        kept = how.add(kept, np.array([source], dtype=np.float64))
    return how.finish(kept, np.array([float(len(sources))]))[0]


def by_definition(rule, sources):
    """Every choice of one subset from each source, and where its product goes."""
    total = np.zeros(4)
    for subsets in itertools.product(range(4), repeat=len(sources)):
        product = np.prod([source[subset] for source, subset in zip(sources, subsets, strict=True)])
        common, union = 3, 0
        for subset in subsets:
            common, union = common & subset, union | subset
        goes_to = common or {"dubois-prade": union, "yager": 3}[rule]
        total[goes_to] += product
    return total


@pytest.mark.parametrize("rule", ["dubois-prade", "yager"])
@given(sources=beliefs)
def test_rules_for_many_sources_are_those_of_their_definition(rule, sources):
    np.testing.assert_allclose(fused(rule, *sources), by_definition(rule, sources), atol=1e-12)


@pytest.mark.parametrize("rule", RULES)
@given(sources=beliefs)
def test_any_order_gives_the_same_belief(rule, sources):
    forth, back = fused(rule, *sources), fused(rule, *sources[::-1])
    np.testing.assert_allclose(forth, back, atol=1e-9)
    assert forth.sum() == pytest.approx(1.0)
    assert forth.min() >= 0.0


@pytest.mark.parametrize(
    ("rule", "contradiction"),
    [
        ("dubois-prade", UNKNOWN),
        ("yager", UNKNOWN),
        ("average", (0.0, 0.5, 0.5, 0.0)),
        ("disjunctive", UNKNOWN),
        ("conjunctive", (1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_what_becomes_of_a_contradiction(rule, contradiction):
    np.testing.assert_allclose(fused(rule, FREE, OCCUPIED), contradiction)


def test_agreement_sharpens_under_dubois_and_prade():
    half = (0.0, 0.5, 0.0, 0.5)
    np.testing.assert_allclose(fused("dubois-prade", half, half), (0.0, 0.75, 0.0, 0.25))
