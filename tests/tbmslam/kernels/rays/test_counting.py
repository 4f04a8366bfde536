import numpy as np
import pytest

from tbmslam.kernels.rays.counting import (
    ONE_HIT,
    beam_ends,
    count_scans,
    counted_tiles,
    hits_in,
    passages_in,
    write_masses,
    write_tiles,
)
from tbmslam.kernels.rays.lattice import Lattice
from tbmslam.sensing.sensor_model import SensorModelConfig, beam_factors
from tests import reference

LATTICE = Lattice(0.1, -120, -120)


def fan(generator, beams, spread=4.0, longest=9.0):
    """Ends of beams in angular order around a laser, some of them blocked early."""
    laser = generator.uniform(-1.0, 1.0, 2)
    angles = np.linspace(0.0, spread, beams) + generator.uniform(-np.pi, np.pi)
    lengths = np.where(generator.random(beams) < 0.2, 0.3, 1.0) * generator.uniform(2.0, longest, beams)
    return laser, laser + lengths[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))


@pytest.mark.parametrize("beams", [1, 2, 40, 181, 720])
@pytest.mark.parametrize("seed", range(3))
def test_counts_are_the_plain_ones(seed, beams):
    generator = np.random.default_rng(seed)
    counts = np.zeros((240, 240), dtype=np.int64)
    scans = [fan(generator, beams) for _ in range(3)]
    is_hit = generator.random(3 * beams) < 0.9
    lasers, ends = np.array([laser for laser, _ in scans]), np.vstack([ends for _, ends in scans])
    count_scans(counts, LATTICE, lasers, ends, is_hit, np.arange(4) * beams, 0)
    hits, passed = np.zeros((240, 240)), np.zeros((240, 240))
    for number, (laser, own) in enumerate(scans):
        hit_cells, passed_cells = reference.cells_of_scan(laser, own, is_hit[number * beams :][:beams], 0.1)
        for total, cells in ((hits, hit_cells), (passed, passed_cells)):
            for row, col in cells:
                total[row - LATTICE.first_row, col - LATTICE.first_col] += 1
    np.testing.assert_array_equal(hits_in(counts), hits)
    np.testing.assert_array_equal(passages_in(counts), passed)


def test_a_beam_of_no_length_passes_its_cell():
    counts = np.zeros((240, 240), dtype=np.int64)
    count_scans(counts, LATTICE, np.zeros((1, 3)), np.zeros((1, 2)), np.zeros(1, dtype=bool), np.array([0, 1]), 0)
    assert passages_in(counts).sum() == passages_in(counts[120, 120]) == 1


def test_ends_are_where_the_beams_point():
    ranges = np.array([1.0, np.nan, np.inf, 8.0, 2.0], dtype=np.float32)
    offsets, beams = np.array([0, 4, 5]), np.array([[0.0, np.pi / 2, 0.1, 5.0]] * 2)
    poses = np.array([[10.0, 20.0, 0.0], [0.0, 0.0, np.pi]])
    ends, is_hit, starts = beam_ends(ranges, offsets, beams, np.zeros((2, 3)), poses, 6.0, False)
    np.testing.assert_allclose(ends, [[11.0, 20.0], [10.0, 15.0], [-2.0, 0.0]], atol=1e-6)
    assert is_hit.tolist() == [True, False, True]
    assert starts.tolist() == [0, 2, 3]
    ends, is_hit, starts = beam_ends(ranges, offsets, beams, np.zeros((2, 3)), poses, 6.0, True)
    np.testing.assert_allclose(ends[1], [5.0, 20.0], atol=1e-6)
    assert is_hit.tolist() == [True, False, False, True]
    assert starts.tolist() == [0, 3, 4]


@pytest.mark.parametrize("keeps_conflict", [True, False])
def test_masses_are_those_of_the_combined_observations(keeps_conflict):
    hits, passed = np.array([[[0, 3, 0], [2, 5, 1]], [[0, 0, 4], [3, 1, 1]]])
    counts = hits * ONE_HIT + passed
    model = SensorModelConfig()
    factors = beam_factors(model, 0.1, 1.0)
    hit, miss = (one[None] ** -np.arange(6.0)[:, None] for one in (factors.hit, factors.miss))
    masses = np.empty((2, 3, 4), dtype=np.float32)
    write_masses(counts, 0, 0, hit, miss, keeps_conflict, masses)
    for row, col in np.ndindex(2, 3):
        expected = reference.repeated(model, hits[row, col], passed[row, col], keeps_conflict)
        np.testing.assert_allclose(masses[row, col], expected, atol=1e-6)


@pytest.mark.parametrize("shape", [(9, 11), (8, 12), (3, 2), (1, 17)])
def test_tiles_hold_the_masses_of_all_counted_cells(shape):
    rng, side = np.random.default_rng(5), 4
    counts = np.where(rng.random(shape) < 0.1, rng.integers(1, 5, shape) * ONE_HIT + rng.integers(0, 5, shape), 0)
    factors = beam_factors(SensorModelConfig(), 0.1, 1.0)
    hit, miss = (one[None] ** -np.arange(6.0)[:, None] for one in (factors.hit, factors.miss))
    masses = np.empty((*shape, 4), dtype=np.float32)
    write_masses(counts, 0, 0, hit, miss, True, masses)
    padded = np.pad(masses, ((0, -shape[0] % side), (0, -shape[1] % side), (0, 0)))
    padded[shape[0] :, :, 3] = padded[:, shape[1] :, 3] = 1.0
    found = np.zeros((len(padded) // side, padded.shape[1] // side), dtype=bool)
    counted_tiles(counts, side, found)
    places = np.argwhere(np.ones_like(found))
    tiles = np.full((len(places), side, side, 4), np.nan, dtype=np.float32)
    write_tiles(counts, places, hit, miss, True, tiles)
    for (row, col), tile in zip(places, tiles, strict=True):
        here = np.s_[row * side : (row + 1) * side, col * side : (col + 1) * side]
        assert found[row, col] == counts[here].any()
        np.testing.assert_array_equal(tile, padded[here])
