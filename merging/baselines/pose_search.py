"""Search for the rotation by Hough spectra, and for the shift by Fourier transforms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from merging.baselines.cell_states import Field, Points, Reals
from tbmslam.geometry.se2 import FloatArray

BINS = 360
"""Directions of a line, 0 to 180 degrees."""


def hough_spectrum(points: Points, weights: FloatArray, cell_m: float) -> FloatArray:
    """Return the Hough spectrum (BINS,): for each direction, the sum of squares of the Hough transform over the lines.

    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 2008, after A. Censi et al.,
    "Scan matching in the Hough domain", 2005.

    Parameters
    ----------
    points, weights
        The points (N, 2) on the lines, and their weights.
    cell_m
        Distance of neighbouring lines [m].
    """
    spectrum = np.empty(BINS)
    for index, angle in enumerate(np.pi * np.arange(BINS) / BINS):
        offsets = np.floor((points * np.exp(-1j * angle)).real / cell_m).astype(np.intp)
        spectrum[index] = (np.bincount(offsets - offsets.min(), weights) ** 2).sum()
    return spectrum


def likely_turns(target: FloatArray, source: FloatArray, count: int) -> FloatArray:
    """Return the rotations [rad] of highest correlation of two spectra (BINS,): two for each of at most `count` maxima.

    A spectrum has the period of half a turn, so that every maximum stands for two turns.
    """
    centred = [spectrum - spectrum.mean() for spectrum in (target, source)]
    likeness = np.fft.irfft(np.fft.rfft(centred[0]) * np.conj(np.fft.rfft(centred[1])), BINS)
    around = np.stack([np.roll(likeness, step) for step in range(-6, 7)])
    maxima = np.flatnonzero(likeness == around.max(axis=0))
    best = maxima[np.argsort(-likeness[maxima], kind="stable")[:count]]
    half = np.pi * best / BINS
    return np.concatenate((half, half + np.pi))


Channel = tuple[Points, Reals]
"""Points (N,) relative to a map's centroid, and their weights (N,)."""


@dataclass(frozen=True)
class ShiftSearch:
    """The target of a search; the source is given already rotated.

    Parameters
    ----------
    spectra
        Fourier transforms of the target's channels.
    size
        Rows and columns of the images.
    cell_m
        Side of their cells [m].
    """

    spectra: tuple[npt.NDArray[np.complexfloating], ...]
    size: tuple[int, int]
    cell_m: float

    @classmethod
    def over(cls, channels: Sequence[Channel], reach_m: float, cell_m: float) -> "ShiftSearch":
        """Prepare a search over all shifts up to a limit; the target's channels are blurred by a cell."""
        side = scipy.fft.next_fast_len(math.ceil(2.2 * reach_m / cell_m), real=True)
        images = [cv2.GaussianBlur(_image(channel, (side, side), cell_m), (0, 0), 1.0) for channel in channels]
        return cls(tuple(scipy.fft.rfft2(image) for image in images), (side, side), cell_m)

    def best(self, channels: Sequence[Channel], count: int) -> tuple[FloatArray, Points]:
        """Return scores and shifts (count,) of the highest peaks of the correlation, summed over the channels."""
        product = np.zeros_like(self.spectra[0])
        for spectrum, channel in zip(self.spectra, channels, strict=True):
            product += spectrum * np.conj(scipy.fft.rfft2(_image(channel, self.size, self.cell_m)))
        scores: Field = np.asarray(scipy.fft.irfft2(product, self.size), dtype=np.float32)
        peaks = np.flatnonzero(scores == cv2.dilate(scores, np.ones((5, 5), np.uint8)))
        best = peaks[np.argsort(-scores.ravel()[peaks], kind="stable")[:count]]
        rows, cols = np.divmod(best, self.size[1])
        rows, cols = (np.where(at < side / 2, at, at - side) for at, side in zip((rows, cols), self.size, strict=True))
        return scores.ravel()[best].astype(np.float64), (cols + 1j * rows) * self.cell_m


def _image(channel: Channel, size: tuple[int, int], cell_m: float) -> Field:
    """Sum the weights of points in cells; the centre is cell (0, 0), and negative cells wrap around."""
    points, weights = channel
    rows = np.floor(points.imag / cell_m).astype(np.intp) % size[0]
    cols = np.floor(points.real / cell_m).astype(np.intp) % size[1]
    return np.bincount(rows * size[1] + cols, weights, size[0] * size[1]).reshape(size).astype(np.float32)
