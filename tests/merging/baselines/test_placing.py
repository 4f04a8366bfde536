import numpy as np
import pytest

from merging.baselines.cell_states import IS_FREE, IS_UNKNOWN, IS_WALL, CellField, CellStates
from merging.baselines.placing import BINS, Agreement, Placing, ShiftSearch, climb, hough_spectrum, likely_turns
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2

CELLS = {"#": (0.0, 0.0, 1.0, 0.0), ".": (0.0, 1.0, 0.0, 0.0), "?": (0.0, 0.0, 0.0, 1.0), "~": (0.0, 0.3, 0.3, 0.4)}


def states(*rows, origin=(0.0, 0.0)):
    masses = np.array([[CELLS[cell] for cell in row] for row in rows], dtype=np.float32)
    return CellStates.of(TbmGrid(GridGeometry(1.0, *origin, *masses.shape[:2]), masses))


def test_cells_are_what_has_more_mass():
    assert states("#.?~").states.tolist() == [[IS_WALL, IS_FREE, IS_UNKNOWN, IS_UNKNOWN]]


def test_the_acceptance_index_counts_agreeing_and_disagreeing_cells():
    target, source = states("#..?"), states("#.##")
    here = Placing(0j, 0j, 5.0)
    agreement = Agreement.of(target, source, here, np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]]))
    np.testing.assert_allclose(agreement.agreeing, [0.5, 0.0])
    np.testing.assert_allclose(agreement.disagreeing, [0.25, 0.0])
    np.testing.assert_allclose(agreement.index(), [1.0 - 2.0 / 3.0, 1.0])


def test_points_are_read_and_what_lies_off_the_grid_is_outside():
    values = np.array([[1.0, 2.0], [3.0, 4.0]], dtype=np.float32)
    points = np.array([0.5 + 0.5j, 1.5 + 0.5j, 0.5 + 1.9j, -0.5 + 0.5j, 0.5 + 2.1j, 900 - 900j])
    field = CellField.of(values, GridGeometry(1.0, 0.0, 0.0, 2, 2), outside=9.0)
    assert field.at(points).tolist() == [1, 2, 3, 9, 9, 9]


def test_places_and_motions_are_the_same_map():
    placing = Placing.of(states("..", "..", origin=(3.0, 1.0)), states("...", origin=(-2.0, 4.0)))
    place = np.array([1.0, -2.0, 0.8])
    motion = placing.motion(place)
    points = np.array([0.3 + 1.0j, -2.0 + 5.0j])
    expected = motion.apply(np.column_stack((points.real, points.imag))) @ [1.0, 1.0j]
    there = placing.into_target(points, place[None])[0]
    np.testing.assert_allclose(there, expected, atol=1e-5)
    np.testing.assert_allclose(placing.into_source(there, place[None])[0], points, atol=1e-5)
    assert SE2(*motion) == motion


def test_climbing_reaches_the_top():
    top = np.array([1.0, -0.5, 0.3])
    found = climb(lambda places: -np.abs(places - top).sum(axis=1), np.zeros((2, 3)), 0.4, 0.2, halvings=8)
    assert found == pytest.approx(np.tile(top, (2, 1)), abs=0.01)


def test_a_wall_makes_a_peak_at_its_normal():
    wall = np.linspace(0.0, 10.0, 300) * np.exp(1j * np.radians(30.0))
    spectrum = hough_spectrum(wall, np.ones(300), 0.05)
    assert np.degrees(np.pi * spectrum.argmax() / BINS) == pytest.approx(120.0, abs=0.5)
    assert spectrum.max() == pytest.approx(300.0**2, rel=0.3)


def test_the_turn_between_two_corners_is_among_the_likely_ones():
    corner = np.concatenate((np.linspace(0.0, 8.0, 200), 1j * np.linspace(0.0, 3.0, 80)))
    turned = corner * np.exp(-1j * np.radians(200.0))
    spectra = [hough_spectrum(points, np.ones(280), 0.05) for points in (corner, turned)]
    turns = np.degrees(likely_turns(spectra[0], spectra[1], 2))
    assert turns[0] == pytest.approx(20.0, abs=0.6)
    assert turns[len(turns) // 2] == pytest.approx(200.0, abs=0.6)


def test_the_true_shift_scores_best():
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, 60) + 1j * rng.uniform(-5, 5, 60)
    search = ShiftSearch.over([(points + (2.0 - 3.0j), np.ones(60))], 12.0, 0.2)
    scores, shifts = search.best([(points, np.ones(60))], 3)
    assert abs(shifts[0] - (2.0 - 3.0j)) <= 0.3
    assert scores[0] > 2.0 * scores[1]


def test_points_of_another_channel_do_not_count():
    here, nothing = (np.array([0.1 + 0.1j]), np.ones(1)), (np.empty(0, dtype=complex), np.empty(0))
    search = ShiftSearch.over([here, nothing], 4.0, 0.2)
    assert search.best([nothing, here], 1)[0][0] < 1e-6 < search.best([here, nothing], 1)[0][0]
