import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.belief.grid import RELIABILITY, GridGeometry, TbmGrid, masses_from_probability
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN, VACUOUS, pignistic
from tests.belief_rules import discount

GEOMETRY = GridGeometry(0.5, -1.0, 2.0, rows=3, cols=4)


def grid_with(*cells):
    """Return an unknown grid but for some (row, col)."""
    grid = TbmGrid.unknown(GEOMETRY)
    for cell in cells:
        grid.masses[cell] = (0.0, 0.5, 0.25, 0.25)
    return grid


def test_cells_and_places():
    assert GEOMETRY.cell_at(-1.0, 2.0) == (0, 0)
    assert GEOMETRY.cell_at(0.99, 3.49) == (2, 3)
    assert GEOMETRY.cell_at(-1.01, 3.5) == (3, -1)
    assert GEOMETRY.centre_of(0, 0) == (-0.75, 2.25)
    assert GEOMETRY.bounds() == (-1.0, 2.0, 1.0, 3.5)


@given(st.integers(-1000, 1000), st.integers(-1000, 1000))
def test_a_cell_s_centre_lies_in_it(row, col):
    assert GEOMETRY.cell_at(*GEOMETRY.centre_of(row, col)) == (row, col)


def test_cells_and_places_of_many():
    points = GEOMETRY.centres_of(np.array([0, 2, 1]), np.array([0, 3, 2]))
    assert [tuple(point) for point in points] == [GEOMETRY.centre_of(*cell) for cell in ((0, 0), (2, 3), (1, 2))]
    rows, cols, inside = GEOMETRY.cells_at(np.vstack((points, [(-1.01, 3.5)])))
    assert (rows.tolist(), cols.tolist()) == ([0, 2, 1, 2], [0, 3, 2, 0])
    assert inside.tolist() == [True, True, True, False]


def test_a_new_grid_is_unknown_and_writable():
    grid = TbmGrid.unknown(GEOMETRY)
    np.testing.assert_array_equal(grid.masses, np.broadcast_to(VACUOUS, (3, 4, 4)))
    assert grid.masses.dtype == np.float32
    assert not grid.is_known().any()
    grid.masses[0, 0, UNKNOWN] = 0.5
    assert grid.is_known().sum() == 1


def test_the_pignistic_picture_is_the_algebra_s():
    grid = grid_with((1, 2))
    np.testing.assert_array_equal(grid.pignistic(), pignistic(grid.masses))


def test_cropping_keeps_places():
    grid = grid_with((1, 1), (2, 2))
    cropped = grid.cropped_to_known()
    assert cropped.geometry == GridGeometry(0.5, -0.5, 2.5, rows=2, cols=2)
    np.testing.assert_array_equal(cropped.masses, grid.masses[1:3, 1:3])
    assert cropped.masses.flags.c_contiguous


def test_a_margin_is_kept_where_there_is_room():
    cropped = grid_with((1, 1)).cropped_to_known(margin=2)
    assert cropped.geometry == GridGeometry(0.5, -1.0, 2.0, rows=3, cols=4)


def test_a_grid_without_evidence_is_not_cropped():
    grid = TbmGrid.unknown(GEOMETRY)
    assert grid.cropped_to_known() is grid


def test_beliefs_have_no_fault():
    assert grid_with((0, 0)).fault() is None
    assert TbmGrid.unknown(GEOMETRY._replace(rows=0)).fault() is None


@pytest.mark.parametrize(
    ("mass", "fault"), [(-0.1, "not zero or more"), (0.5, "miss the sum of 1 by 0.5"), (np.nan, "nan"), (np.inf, "inf")]
)
def test_faults_are_named(mass, fault):
    grid = TbmGrid.unknown(GEOMETRY)
    grid.masses[2, 3, 0] = mass
    assert fault in str(grid.fault())


@pytest.mark.parametrize("shape", [(3, 4), (4, 3, 4), (3, 4, 3)])
def test_masses_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"masses must have the shape \(3, 4, 4\) of the geometry, got"):
        TbmGrid(GEOMETRY, np.zeros(shape, dtype=np.float32))


@pytest.mark.parametrize("resolution", [0.0, -0.05, np.nan, np.inf])
def test_a_cell_has_a_size(resolution):
    with pytest.raises(ValueError, match="resolution must be positive, got"):
        TbmGrid.unknown(GEOMETRY._replace(resolution=resolution))


@pytest.mark.parametrize("field", ["origin_x", "origin_y"])
def test_a_grid_lies_somewhere(field):
    with pytest.raises(ValueError, match="origin must be finite, got"):
        TbmGrid.unknown(GEOMETRY._replace(**{field: np.nan}))


def test_a_grid_is_shown_in_a_line_and_as_a_picture():
    grid = TbmGrid.unknown(GridGeometry(0.5, 0.0, 0.0, 3, 4))
    grid.masses[0, 0] = [0.0, 1.0, 0.0, 0.0]
    grid.masses[2, 3] = [0.0, 0.0, 1.0, 0.0]
    assert repr(grid) == "TbmGrid(4 x 3 cells of 0.5 m, 0.5 m2 known)"
    picture = cv2.imdecode(np.frombuffer(grid._repr_png_(), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.tolist() == [[128, 128, 128, 0], [128] * 4, [255, 128, 128, 128]]
    assert TbmGrid.unknown(GridGeometry(0.5, 0.0, 0.0, 0, 4))._repr_png_() is None


PROBABILITIES = np.linspace(0.0, 1.0, 101)


def test_they_are_beliefs():
    masses = masses_from_probability(PROBABILITIES, PROBABILITIES < 2.0)
    assert masses.dtype == np.float32
    assert (masses >= 0.0).all()
    np.testing.assert_allclose(masses.sum(axis=-1), 1.0, atol=1e-6)


def test_undiscounted_they_would_bet_the_given_probability():
    lean = 2.0 * PROBABILITIES - 1.0
    certain = np.zeros((101, 4))
    certain[:, OCCUPIED], certain[:, FREE] = np.maximum(lean, 0.0), np.maximum(-lean, 0.0)
    certain[:, UNKNOWN] = 1.0 - abs(lean)
    np.testing.assert_allclose(pignistic(certain), PROBABILITIES, atol=1e-12)
    masses = masses_from_probability(PROBABILITIES, np.ones(101, dtype=bool))
    np.testing.assert_allclose(masses, discount(certain, RELIABILITY), atol=1e-6)


@pytest.mark.parametrize(
    ("probability", "known", "expected"),
    [
        (1.0, True, [0.0, 0.0, 0.9, 0.1]),
        (0.0, True, [0.0, 0.9, 0.0, 0.1]),
        (0.5, True, [0.0, 0.0, 0.0, 1.0]),
        (1.0, False, [0.0, 0.0, 0.0, 1.0]),
    ],
)
def test_certain_even_and_unknown(probability, known, expected):
    np.testing.assert_allclose(masses_from_probability(np.array(probability), np.array(known)), expected, atol=1e-6)
