import math

import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.rays.insertion import RATIO_LIMIT, beams_of_scan, insert_beams, walk_beam
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.kernels.search.scoring import impact_at
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors
from tests import reference
from tests.belief_rules import normalise

RESOLUTION = 0.1
MODEL = SensorModelConfig()


def beams(seed, count=40, longest=4.0):
    generator = np.random.default_rng(seed)
    start = generator.uniform(-0.5, 0.5, 2)
    angles = generator.uniform(-math.pi, math.pi, count)
    lengths = generator.uniform(0.0, longest, count)
    ends = start + np.column_stack((lengths * np.cos(angles), lengths * np.sin(angles)))
    return start, ends, generator.random(count) < 0.8


def filled_grid(start, ends, is_hit, model, quality):
    grid = EvidenceGrid(RESOLUTION)
    grid.grow_to_contain(np.vstack((ends, start)))
    insert_beams(grid.ratios, grid.lattice, start[None], ends, is_hit, beam_factors(model, RESOLUTION, quality))
    return grid


def assert_grid_holds(grid, cells):
    masses = grid.to_tbm_grid().masses
    known = {(r + grid.first_row, c + grid.first_col) for r, c in np.argwhere(masses[..., 3] < 1.0)}
    assert known == set(cells)
    rows, cols = (np.array(list(cells)) - (grid.first_row, grid.first_col)).T
    np.testing.assert_allclose(masses[rows, cols], normalise(np.array(list(cells.values()))), atol=1e-6)


@pytest.mark.parametrize("seed", range(30))
def test_beams_are_combined_by_dempsters_rule(seed):
    start, ends, is_hit = beams(seed)
    grid = filled_grid(start, ends, is_hit, MODEL, 0.9)
    cells = {}
    reference.insert_beams(cells, RESOLUTION, start, ends, is_hit, MODEL, 0.9)
    assert_grid_holds(grid, cells)


@pytest.mark.parametrize("seed", range(5))
def test_added_evidence_is_the_mean_of_what_a_cell_was_given(seed):
    model = SensorModelConfig(wall_blur=0.5, combination="mean")
    start, ends, is_hit = beams(seed)
    grid = filled_grid(start, ends, is_hit, model, 0.6)
    cells = {}
    reference.insert_beams_as_means(cells, RESOLUTION, start, ends, is_hit, model, 0.6)
    means = {cell: [0.0, 1.0 - np.mean(given), np.mean(given), 0.0] for cell, given in cells.items()}
    assert_grid_holds(grid, means)
    cell = next(iter(cells))
    score = impact_at(grid.ratios, cell[0] - grid.first_row, cell[1] - grid.first_col)
    assert score == pytest.approx(np.mean(cells[cell]), abs=1e-6)


@pytest.mark.parametrize("seed", range(200))
def test_walk_is_the_plain_one(seed):
    start, ends, _ = beams(1000 + seed, count=1)
    cells = np.empty((200, 2), dtype=np.int64)
    count = walk_beam(*start, *ends[0], RESOLUTION, cells)
    assert [tuple(cell) for cell in cells[:count]] == reference.walk(start, ends[0], RESOLUTION)


def test_a_walk_that_misses_its_end_falls_back_to_bresenham():
    # The end lies just across a border, so the nearer neighbour's centre leads past it.
    cells = np.empty((400, 2), dtype=np.int64)
    generator = np.random.default_rng(5)
    fallbacks = 0
    for _ in range(4000):
        start = generator.uniform(0.0, 0.1, 2)
        end = np.round(generator.uniform(-1.0, 1.0, 2), 1) + generator.choice([-1e-9, 1e-9], 2)
        count = walk_beam(*start, *end, RESOLUTION, cells)
        assert tuple(cells[count - 1]) == tuple(np.floor(end[::-1] / RESOLUTION))
        steps = np.abs(np.diff(cells[:count], axis=0))
        assert steps.max(initial=0) <= 1
        fallbacks += int((steps.sum(axis=1) == 2).any())
    assert fallbacks > 0


def test_endless_evidence_neither_overflows_nor_forgets():
    grid = EvidenceGrid(RESOLUTION)
    grid.grow_to_contain(np.array([[0.0, 0.0], [1.0, 0.0]]))
    model = SensorModelConfig(hit_quality=0.9, miss_quality=0.9, wall_blur=0.0)
    factors = beam_factors(model, RESOLUTION, 1.0)
    start, ends = np.array([0.05, 0.05]), np.array([[0.95, 0.05]])
    for _ in range(2000):
        insert_beams(grid.ratios, grid.lattice, start[None], ends, np.array([True]), factors)
    assert np.isfinite(grid.ratios).all()
    assert grid.ratios.max() <= RATIO_LIMIT
    masses = grid.to_tbm_grid().masses
    row = -grid.first_row
    assert masses[row, 9 - grid.first_col, 2] == pytest.approx(1.0)
    assert masses[row, 4 - grid.first_col, 1] == pytest.approx(1.0)


def test_beams_of_a_moving_laser_are_the_plain_ones():
    """A laser that drives an arc during a sweep: each beam starts where the laser then is."""
    generator = np.random.default_rng(6)
    ranges = generator.uniform(0.5, 5.0, 60)
    ranges[[3, 20]], ranges[40] = np.nan, np.inf
    pose, step = SE2(1.0, -2.0, 0.7), SE2.exp(0.02, 0.01, 0.015)
    starts, ends, is_hit, corners = beams_of_scan(ranges, (-1.0, 0.03), tuple(step), tuple(pose), (4.0, 4.5), True)
    expected, then = [], pose
    for i, length in enumerate(ranges.tolist()):
        if not math.isnan(length):
            beam = then @ SE2(0.0, 0.0, -1.0 + 0.03 * i)
            reached = length if length <= 4.0 else min(length, 4.5)
            expected.append(((then.x, then.y), beam.apply(np.array([reached, 0.0])), length <= 4.0))
        then = then @ step
    for found, wanted in zip((starts, ends, is_hit), zip(*expected, strict=True), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-9)
    np.testing.assert_allclose(corners, [np.minimum(starts, ends).min(0), np.maximum(starts, ends).max(0)])


def test_evidence_at_the_limit_keeps_what_speaks_against_it():
    """A cell that is almost surely free stays surer of free than of occupied once its numbers are scaled down."""
    ratios = np.array([[[0.9 * RATIO_LIMIT, 3.0]]])
    insert_beams(
        ratios,
        Lattice(RESOLUTION, 0, 0),
        np.array([[0.05, 0.05]]),
        np.array([[0.05, 0.05]]),
        np.array([False]),
        beam_factors(SensorModelConfig(miss_quality=0.9, wall_blur=0.0), RESOLUTION, 1.0),
    )
    assert 1e6 < ratios[0, 0, 0] < RATIO_LIMIT
    assert ratios[0, 0, 1] == 1.0
