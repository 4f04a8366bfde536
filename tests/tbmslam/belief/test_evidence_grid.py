import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbmslam.belief.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, VACUOUS
from tests.belief_rules import conjunctive, dempster


def with_cells(ratios):
    grid = EvidenceGrid(0.1)
    grid.ratios = np.asarray(ratios, dtype=np.float64)
    return grid


@given(arrays(np.float64, (3, 2), elements=st.floats(0.0, 0.9)))
def test_products_of_ratios_are_the_conjunctive_rule(observations):
    """Each observation commits one mass to free and a share of the rest to occupied."""
    masses, ratios = VACUOUS, np.ones(2)
    for free, share in observations:
        occupied = share * (1.0 - free) * 0.9
        unknown = 1.0 - free - occupied
        masses = conjunctive(masses, [0.0, free, occupied, unknown])
        ratios = ratios * [(free + unknown) / unknown, (occupied + unknown) / unknown]
    normalised = with_cells(ratios[None, None]).to_tbm_grid().masses[0, 0]
    np.testing.assert_allclose(normalised, dempster(masses, VACUOUS), atol=1e-6)


def test_kept_conflict_is_that_of_hits_against_passages():
    hits, passages = [0.0, 0.0, 0.6, 0.4], [0.0, 0.7, 0.0, 0.3]
    masses = with_cells([[[1.0 / 0.3, 1.0 / 0.4]]]).to_tbm_grid(keep_conflict=True).masses[0, 0]
    np.testing.assert_allclose(masses, conjunctive(hits, passages), atol=1e-6)
    assert masses[CONFLICT] == pytest.approx(0.42)


def test_fresh_cells_know_nothing():
    grid = EvidenceGrid(0.1)
    grid.grow_to_contain(np.zeros((1, 2)))
    for keep in (False, True):
        np.testing.assert_array_equal(grid.to_tbm_grid(keep).masses, np.broadcast_to([0, 0, 0, 1], (3, 3, 4)))


@given(arrays(np.int64, (20, 2), elements=st.integers(-3000, 3000)))
def test_growing_keeps_every_cell_in_its_place(centimetres):
    points = centimetres * 0.01 + 0.005
    grid = EvidenceGrid(0.5)
    noted = {}
    for number, point in enumerate(points):
        grid.grow_to_contain(point[None])
        row, col = grid.geometry.cell_at(*point)
        assert 0 < row < grid.geometry.rows - 1
        assert 0 < col < grid.geometry.cols - 1
        grid.ratios[row, col] = 2.0 + number
        noted[tuple(np.floor(point / 0.5))] = (point, 2.0 + number)
    for point, value in noted.values():
        assert (grid.ratios[grid.geometry.cell_at(*point)] == value).all()
    assert (grid.ratios > 1.0).all(axis=2).sum() == len(noted)


def test_growth_is_rare():
    grid = EvidenceGrid(0.1)
    sizes = set()
    for x in np.arange(0.0, 100.0, 0.1):
        grid.grow_to_contain(np.array([[x, 0.0]]))
        sizes.add(grid.geometry.cols)
    assert len(sizes) < 50


def test_a_grid_that_would_be_too_large_stays_as_it_was():
    grid = EvidenceGrid(0.1, max_cells=1000)
    grid.grow_to_contain(np.zeros((1, 2)))
    with pytest.raises(
        GridTooLargeError, match=r"more than the limit of 1000 cells: raise map.max_cells, use a coarser map.resolution"
    ):
        grid.grow_to_contain(np.array([[100.0, 100.0]]))
    assert grid.geometry.rows == 3


def test_resolution_must_be_positive():
    with pytest.raises(ValueError, match=r"resolution must be positive, got 0"):
        EvidenceGrid(0)


def test_masses_are_in_their_order():
    masses = with_cells([[[4.0, 2.0]]]).to_tbm_grid().masses[0, 0]
    assert masses[FREE] == pytest.approx(3 / 5)
    assert masses[OCCUPIED] == pytest.approx(1 / 5)
    assert masses[UNKNOWN] == pytest.approx(1 / 5)
