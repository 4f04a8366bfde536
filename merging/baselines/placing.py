"""Poses as a shift between centroids and a rotation: the search for them, and the agreement of two maps there."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_UNKNOWN, CellStates, Field, Points, Reals
from merging.config import MergeConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle

Score = Callable[[FloatArray], FloatArray]
"""Returns the scores (K,) of placements (K, 3)."""


@dataclass(frozen=True)
class Placing:
    """Transforms points between two maps under placements (K, 3): a shift x, y [m] and a rotation [rad]."""

    target_centre: complex
    source_centre: complex
    """Centroids of the known cells of the maps, each in its own frame."""
    reach_m: float
    """Largest shift at which the maps can overlap."""

    @classmethod
    def of(cls, target: CellStates, source: CellStates) -> "Placing":
        """Return the placing of two maps."""
        return cls(target.centre, source.centre, target.radius_m + source.radius_m)

    def into_target(self, points: Points, places: FloatArray) -> Points:
        """Return the source's points (N,) in the target's frame under each placement (K, N)."""
        turns, shifts = np.exp(1j * places[:, 2]), places[:, 0] + 1j * places[:, 1] + self.target_centre
        moved = (points - self.source_centre).astype(np.complex64) * turns.astype(np.complex64)[:, None]
        return np.asarray(moved + shifts.astype(np.complex64)[:, None])

    def into_source(self, points: Points, places: FloatArray) -> Points:
        """Return the target's points (N,) in the source's frame under each placement (K, N)."""
        turns, shifts = np.exp(-1j * places[:, 2]), places[:, 0] + 1j * places[:, 1]
        moved = (points - self.target_centre).astype(np.complex64) - shifts.astype(np.complex64)[:, None]
        return np.asarray(moved * turns.astype(np.complex64)[:, None] + np.complex64(self.source_centre))

    def motion(self, place: FloatArray) -> SE2:
        """Return T_target_source of a placement (3,)."""
        x, y, theta = (float(value) for value in place)
        translation = self.target_centre + complex(x, y) - np.exp(1j * theta) * self.source_centre
        return SE2(float(translation.real), float(translation.imag), wrap_angle(theta))


def climb(score: Score, places: FloatArray, step_m: float, step_rad: float, halvings: int = 5) -> FloatArray:
    """Improve placements (K, 3) by steps along x, y and the rotation; steps are halved if none improves the score."""
    places, values = places.copy(), score(places)
    steps = np.tile((step_m, step_m, step_rad), (len(places), 1))
    directions = np.concatenate((np.eye(3), -np.eye(3)))
    for _ in range(4 * halvings):
        around = places[:, None] + directions * steps[:, None]
        found = score(around.reshape(-1, 3)).reshape(len(places), 6)
        best = found.argmax(axis=1)
        better = found[np.arange(len(places)), best] > values
        places[better] = around[np.arange(len(places)), best][better]
        values = np.where(better, found.max(axis=1), values)
        steps[~better] /= 2.0
        if steps[:, 0].max() < step_m / 2.0**halvings:
            break
    return places


@dataclass(frozen=True)
class Agreement:
    """Shares of the source's known cells that agree with the target's, and that contradict them."""

    agreeing: FloatArray
    disagreeing: FloatArray
    """One for each place (K,)."""

    @classmethod
    def of(
        cls, target: CellStates, source: CellStates, placing: Placing, places: FloatArray, limit: int | None = None
    ) -> "Agreement":
        """Compare the source with the target at placements (K, 3), by all of its known cells or about `limit`."""
        points, states = source.known
        every = max(1, len(points) // limit) if limit is not None else 1
        points, states = points[::every], states[::every]
        there = target.field.at(placing.into_target(points, places))
        agreeing = np.mean(there == states, axis=1)
        return cls(agreeing, np.mean(there != IS_UNKNOWN, axis=1) - agreeing)

    def index(self) -> FloatArray:
        """Return the acceptance index (K,), ai = 1 - agr / (agr + dis): 0 if all agree, 1 without overlap."""
        met = self.agreeing + self.disagreeing
        return 1.0 - np.divide(self.agreeing, met, out=np.zeros_like(met), where=met > 0.0)


def judged_alignment(
    method: str,
    maps: tuple[CellStates, CellStates],
    placing: Placing,
    place: FloatArray,
    measure: tuple[str, bool],
    config: MergeConfig,
) -> Alignment:
    """Return the alignment of a method, accepted if the method's own measure and the overlap are sufficient.

    `place` (3,) is the best pose. `measure` is the method's measure as text, and whether it suffices.
    """
    target, source = maps
    agreement = Agreement.of(target, source, placing, place[None])
    both = float(agreement.agreeing[0] + agreement.disagreeing[0])
    cells = [int(np.count_nonzero(side.states != IS_UNKNOWN)) for side in maps]
    share, needed = both * cells[1] / min(cells), config.baselines.min_overlap_share
    words, good = measure
    reason = words if share >= needed else f"the maps overlap by {share:.0%}, under {needed:.0%}"
    return Alignment(
        method=method,
        accepted=good and share >= needed,
        reason=reason,
        T_target_source=placing.motion(place),
        overlap_m2=both * cells[1] * source.geometry.resolution**2,
    )


BINS = 360
"""Directions of a line, 0 to 180 degrees."""


def hough_spectrum(points: Points, weights: FloatArray, cell_m: float) -> FloatArray:
    """Return the Hough spectrum (BINS,): for each direction, the sum of squares of the Hough transform over the lines.

    The lines of weighted points (N, 2) are `cell_m` apart [m]. S. Carpin, "Fast and accurate map merging for
    multi-robot systems", Autonomous Robots 2008, after A. Censi et al., "Scan matching in the Hough domain", 2005.
    """
    spectrum = np.empty(BINS)
    for index, angle in enumerate(np.pi * np.arange(BINS) / BINS):
        offsets = np.floor((points * np.exp(-1j * angle)).real / cell_m).astype(np.intp)
        spectrum[index] = (np.bincount(offsets - offsets.min(), weights) ** 2).sum()
    return spectrum


def likely_turns(target: FloatArray, source: FloatArray, count: int) -> FloatArray:
    """Return the rotations [rad] of highest correlation of two spectra (BINS,): two for each of at most `count` maxima.

    A spectrum has a period of half a turn, so every maximum represents two rotations.
    """
    centred = [spectrum - spectrum.mean() for spectrum in (target, source)]
    correlation = np.fft.irfft(np.fft.rfft(centred[0]) * np.conj(np.fft.rfft(centred[1])), BINS)
    around = np.stack([np.roll(correlation, step) for step in range(-6, 7)])
    maxima = np.flatnonzero(correlation == around.max(axis=0))
    best = maxima[np.argsort(-correlation[maxima], kind="stable")[:count]]
    half = np.pi * best / BINS
    return np.concatenate((half, half + np.pi))


Channel = tuple[Points, Reals]
"""Points (N,) relative to a map's centroid, and their weights (N,)."""


@dataclass(frozen=True)
class ShiftSearch:
    """The target of a search; the source is given already rotated."""

    spectra: tuple[npt.NDArray[np.complexfloating], ...]
    """Fourier transforms of the target's channels."""
    size: tuple[int, int]
    """Rows and columns of the images."""
    cell_m: float
    """Side of their cells [m]."""

    @classmethod
    def over(cls, channels: Sequence[Channel], reach_m: float, cell_m: float) -> "ShiftSearch":
        """Prepare a search over all shifts up to a limit; the target's channels are blurred by a cell."""
        side = scipy.fft.next_fast_len(math.ceil(2.2 * reach_m / cell_m), real=True)
        images = [cv2.GaussianBlur(_image(channel, (side, side), cell_m), (0, 0), 1.0) for channel in channels]
        return cls(tuple(scipy.fft.rfft2(image) for image in images), (side, side), cell_m)

    def placements(
        self, turns: Iterable[float], channels_at: Callable[[float], Sequence[Channel]], peaks: int, count: int
    ) -> FloatArray:
        """Return the `count` best placements (K, 3), of the best `peaks` shifts for each rotation [rad]."""
        found = []
        for turn in turns:
            scores, shifts = self.best(channels_at(turn), peaks)
            found.append(np.column_stack((scores, shifts.real, shifts.imag, np.full(len(scores), turn))))
        ranked = np.concatenate(found)
        return np.asarray(ranked[np.argsort(-ranked[:, 0], kind="stable")][:count, 1:])

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
