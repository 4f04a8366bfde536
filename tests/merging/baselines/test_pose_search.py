import numpy as np
import pytest

from merging.baselines.placing import BINS, ShiftSearch, hough_spectrum, likely_turns


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
