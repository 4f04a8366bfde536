import numpy as np
import pytest

from merging.experiments.halves import fuse_halves


def test_the_rules_keep_what_the_paper_says(pair):
    halves = fuse_halves(pair.target)
    known = pair.target.is_known()
    strip = np.zeros_like(known)
    strip[:, 98:102] = True
    assert halves.known_share(halves.conjunctive) == halves.known_share(halves.union) == 1.0
    np.testing.assert_array_equal(halves.disjunctive.is_known(), known & strip)
    before = halves.unknown_in_overlap(halves.left)
    assert halves.unknown_in_overlap(halves.conjunctive) < before < halves.unknown_in_overlap(halves.disjunctive)
    outside = halves.union.masses[:, :98]
    np.testing.assert_array_equal(outside, pair.target.masses[:, :98])


def test_halves_must_meet(pair):
    with pytest.raises(ValueError, match=r"share must lie within \[0.5, 1\], got 0.4"):
        fuse_halves(pair.target, 0.4)
