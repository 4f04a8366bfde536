import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tools.paper.map_pair import MapPair, fuse_halves


def test_right_is_near_the_true_place(pair):
    source = np.array([[1.0, 2.0], [5.0, 5.0]])
    target = pair.T_target_source.apply(source) + np.array([[0.0, 0.2], [0.0, 0.4]])
    assert pair.is_right(target, source, 0.3).tolist() == [True, False]


def test_displacement_is_the_mean_distance_of_known_cells(pair):
    truth = pair.T_target_source.matrix()[:2]
    assert pair.displacement_m(truth) == pytest.approx(0.0, abs=1e-9)
    shifted = truth + np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.4]])
    assert pair.displacement_m(shifted) == pytest.approx(0.5)


def test_overlap(pair):
    assert pair.overlap() > 0.97
    apart = MapPair("one", "two", pair.target, pair.target, SE2(10.0, 0.0, 0.0))
    assert apart.overlap() == pytest.approx(90 / 190, abs=0.01)
    nothing = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 4, 4))
    assert MapPair("one", "none", pair.target, nothing, SE2.identity()).overlap() == 0.0


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
