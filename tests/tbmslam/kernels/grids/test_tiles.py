import math

import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.kernels.grids.tiles import HitModel, climb_posterior, log_likelihood, log_posterior, sampled_posterior
from tbmslam.kernels.rays.insertion import insert_scan, touched_cells
from tbmslam.related.particle_tracker import TileMaps
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors

FACTORS = beam_factors(SensorModelConfig(hit_quality=0.4, miss_quality=0.1, wall_blur=0.0), 0.1, 1.0)
MODEL = HitModel(gain=0.5, clutter=0.05, unknown=0.3, spread=0.8)
DEVIATIONS = (0.1, 0.05)


@pytest.fixture(scope="module")
def room():
    """A round-ish room seen a few times from its middle, as tiles and as one grid, and the hits of one scan."""
    generator = np.random.default_rng(4)
    angles = np.linspace(-math.pi, math.pi, 120, endpoint=False)
    ranges = 3.0 + np.cos(2 * angles) + 0.5 * np.cos(3 * angles)
    hits = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
    maps, grid = TileMaps(1, 0.1), EvidenceGrid(0.1)
    for _ in range(5):
        ends, start = hits + generator.normal(0.0, 0.01, hits.shape), np.zeros(2)
        grid.grow_to_contain(ends)
        insert_scan(grid.ratios, grid.lattice, start[None], ends, np.ones(120, dtype=bool), FACTORS)
        maps.insert(0, *touched_cells(start[None], ends, np.ones(120, dtype=bool), 0.1), FACTORS)
    return maps.grid(0), grid, hits


def plain_log_likelihood(masses, grid, points, pose):
    x, y, theta = pose
    total = 0.0
    for px, py in points:
        at = np.array(
            [y + math.sin(theta) * px + math.cos(theta) * py, x + math.cos(theta) * px - math.sin(theta) * py]
        )
        cell = np.floor(at / 0.1).astype(int)
        near = 0.02
        for offset in np.ndindex(3, 3):
            neighbour = cell + offset - 1
            if (neighbour // 64 != cell // 64).any():
                continue
            away = (((neighbour + 0.5) - at / 0.1) ** 2).sum()
            if away < 1.5:
                near = max(near, masses(neighbour)[2] * math.exp(-0.5 * away / 0.8**2))
        chance = max(near, 0.3 * masses(cell)[3])
        total += math.log(0.05 + 0.95 * chance)
    return 0.5 * total


def test_likelihood_is_the_plain_one(room):
    tiles, grid, hits = room
    values = grid.to_tbm_grid().masses

    def masses(cell):
        row, col = cell[0] - grid.first_row, cell[1] - grid.first_col
        inside = 0 <= row < values.shape[0] and 0 <= col < values.shape[1]
        return values[row, col] if inside else np.array([0.0, 0.0, 0.0, 1.0])

    for pose in [(0.0, 0.0, 0.0), (0.07, -0.2, 0.3), (40.0, 0.0, 0.0)]:
        expected = plain_log_likelihood(masses, grid, hits, pose)
        assert log_likelihood(tiles, hits, pose, MODEL) == pytest.approx(expected, rel=1e-4)


def test_the_posterior_climbs_to_where_the_scan_was_taken(room):
    tiles, _, hits = room
    guess = (0.08, -0.06, 0.05)
    x, y, theta, best = climb_posterior(tiles, hits, guess, DEVIATIONS, MODEL, (0.1, 0.05), 6)
    np.testing.assert_allclose([x, y, theta], 0.0, atol=0.02)
    assert best == pytest.approx(log_posterior(tiles, hits, (x, y, theta), guess, DEVIATIONS, MODEL))
    assert best > log_posterior(tiles, hits, guess, guess, DEVIATIONS, MODEL)


def test_without_hits_the_posterior_is_the_prior(room):
    tiles, _, _ = room
    nothing = np.empty((0, 2))
    guess = (1.0, 2.0, 0.5)
    assert climb_posterior(tiles, nothing, guess, DEVIATIONS, MODEL, (0.1, 0.05), 3)[:3] == guess
    assert log_posterior(tiles, nothing, (1.1, 2.0, 0.55), guess, DEVIATIONS, MODEL) == pytest.approx(-1.0)


def test_samples_tell_where_the_posterior_is_wide(room):
    tiles, _, _ = room
    wall = np.column_stack((np.linspace(-20.0, -19.0, 50), np.full(50, 0.3)))  # nothing is known there
    mean, covariance, evidence = sampled_posterior(
        tiles, wall, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), DEVIATIONS, MODEL, (0.1, 0.05)
    )
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    weight = 2 * math.exp(-0.5) / (1 + 2 * math.exp(-0.5))
    np.testing.assert_allclose(np.diag(covariance), np.array([0.1, 0.1, 0.05]) ** 2 * weight, rtol=1e-9)
    mean_prior = ((1 + 2 * math.exp(-0.5)) / 3) ** 3
    assert evidence == pytest.approx(log_likelihood(tiles, wall, (0.0, 0.0, 0.0), MODEL) + math.log(mean_prior))


@pytest.mark.parametrize("ends_there", [True, False])
def test_endless_evidence_stays_finite_and_is_not_forgotten(ends_there):
    maps, cell = TileMaps(1, 0.1), np.array([[3, 4]], dtype=np.int32)
    for _ in range(1000):
        maps.insert(0, cell, np.array([ends_there]), FACTORS)
    free, occupied = maps.grid(0).tiles[1, 3, 4]
    assert np.isfinite([free, occupied]).all()
    assert (occupied if ends_there else free) > 1e15
    assert 1.0 <= (free if ends_there else occupied) < 2.0
