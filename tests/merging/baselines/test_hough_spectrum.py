import numpy as np
import pytest

from merging.baselines.hough_spectrum import BINS, hough_spectrum, likely_turns


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
