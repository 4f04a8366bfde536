import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.belief.masses import OCCUPIED
from tbmslam.kernels.search.scoring import climb_hill, search_monte_carlo, weighted_impact
from tests import reference
from tests.belief_rules import disjunctive


@pytest.fixture
def world():
    """A random grid, the same as a dict of masses, and a scan."""
    generator = np.random.default_rng(3)
    grid = EvidenceGrid(0.1)
    grid.grow_to_contain(np.array([[-2.0, -2.0], [2.0, 2.0]]))
    grid.ratios[:] = np.exp(generator.exponential(1.0, grid.ratios.shape))
    masses = grid.to_tbm_grid().masses.astype(np.float64)
    cells = {
        (r + grid.first_row, c + grid.first_col): masses[r, c]
        for r in range(masses.shape[0])
        for c in range(masses.shape[1])
    }
    points = generator.uniform(-2.2, 2.2, (60, 2))
    weights = generator.random(60)
    return grid, cells, points, weights / weights.sum()


def test_score_is_the_plain_one(world):
    grid, cells, points, weights = world
    for pose in [(0.0, 0.0, 0.0), (0.13, -0.4, 0.7), (5.0, 5.0, 1.0)]:
        score = weighted_impact(grid.ratios, grid.lattice, points, weights, pose)
        assert score == pytest.approx(reference.weighted_impact(cells, 0.1, points, weights, pose), abs=1e-6)


def test_the_disjunctive_score_is_the_mass_that_both_give_to_occupied(world):
    grid, cells, points, weights = world
    inside = points[np.abs(points).max(axis=1) < 1.9]
    score = weighted_impact(grid.ratios, grid.lattice, inside, weights[: len(inside)], (0.0, 0.0, 0.0), True)
    rows_cols = np.floor(inside[:, ::-1] / 0.1).astype(int)
    both = [disjunctive(cells[tuple(cell)], [0.0, 0.0, 1.0, 0.0])[OCCUPIED] for cell in rows_cols]
    assert score == pytest.approx(weights[: len(inside)] @ both, abs=1e-6)
    assert weighted_impact(grid.ratios, grid.lattice, points, weights, (50.0, 0.0, 0.0), True) == 0.0


def test_outside_the_map_nothing_is_known(world):
    grid, _, points, weights = world
    assert weighted_impact(grid.ratios, grid.lattice, points, weights, (50.0, 0.0, 0.0)) == pytest.approx(0.5)


def test_hill_climbing_is_the_plain_one(world):
    grid, _, points, weights = world

    def score(pose):
        return weighted_impact(grid.ratios, grid.lattice, points, weights, tuple(float(v) for v in pose))

    for guess in [(0.0, 0.0, 0.0), (0.2, -0.1, 0.3)]:
        x, y, theta, best, scored = climb_hill(grid.ratios, grid.lattice, points, weights, guess, (0.1, 0.1), 6, False)
        expected, expected_score = reference.climb_hill(score, guess, 0.1, 0.1, 6)
        np.testing.assert_allclose((x, y, theta), expected, atol=1e-12)
        assert best == pytest.approx(expected_score)
        assert scored >= 37


def test_one_more_candidate_is_one_more(world):
    grid, _, points, weights = world
    arguments = (grid.ratios, grid.lattice, points, weights, (0.0, 0.0, 0.0), (0.1, 0.1), 6)
    assert climb_hill(*arguments, True)[4] == climb_hill(*arguments, False)[4] + 1


def test_monte_carlo_stops_at_the_first_better_candidate(world):
    grid, _, points, weights = world
    offsets = np.random.default_rng(1).normal(0.0, 0.3, (50, 3))
    pose = (0.0, 0.0, 0.0)
    start = weighted_impact(grid.ratios, grid.lattice, points, weights, pose)
    scores = [weighted_impact(grid.ratios, grid.lattice, points, weights, tuple(o)) for o in offsets.tolist()]
    first = next(i for i, score in enumerate(scores) if score > start)
    index, score = search_monte_carlo(grid.ratios, grid.lattice, points, weights, pose, start, offsets)
    assert (index, score) == (first, scores[first])
    assert search_monte_carlo(grid.ratios, grid.lattice, points, weights, pose, 2.0, offsets) == (-1, 2.0)
