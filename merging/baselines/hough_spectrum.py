"""The directions of a map's lines, and the turns that bring those of two maps together."""

import numpy as np

from merging.baselines.cell_states import Points
from tbmslam.geometry.se2 import FloatArray

BINS = 360
"""Directions of a line, 0 to 180 degrees."""


def hough_spectrum(points: Points, weights: FloatArray, cell_m: float) -> FloatArray:
    """Return the Hough spectrum (BINS,): at each direction, the squares of the Hough transform added up over the lines.

    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 2008, after A. Censi et al.,
    "Scan matching in the Hough domain", 2005.

    Parameters
    ----------
    points, weights
        What lies on the lines (N,), and how much each counts.
    cell_m
        Distance of neighbouring lines [m].
    """
    spectrum = np.empty(BINS)
    for index, angle in enumerate(np.pi * np.arange(BINS) / BINS):
        offsets = np.floor((points * np.exp(-1j * angle)).real / cell_m).astype(np.intp)
        spectrum[index] = (np.bincount(offsets - offsets.min(), weights) ** 2).sum()
    return spectrum


def likely_turns(target: FloatArray, source: FloatArray, count: int) -> FloatArray:
    """Return the turns [rad], two for each of at most `count` maxima, at which two spectra (BINS,) correlate most.

    A spectrum has the period of half a turn, so that every maximum stands for two turns.
    """
    centred = [spectrum - spectrum.mean() for spectrum in (target, source)]
    likeness = np.fft.irfft(np.fft.rfft(centred[0]) * np.conj(np.fft.rfft(centred[1])), BINS)
    around = np.stack([np.roll(likeness, step) for step in range(-6, 7)])
    maxima = np.flatnonzero(likeness == around.max(axis=0))
    best = maxima[np.argsort(-likeness[maxima], kind="stable")[:count]]
    half = np.pi * best / BINS
    return np.concatenate((half, half + np.pi))
