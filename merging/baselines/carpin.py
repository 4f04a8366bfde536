"""Carpin: the rotation by Hough spectra, the shift by projections onto two axes.

S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 2008. The circular correlation of
the maps' Hough spectra gives candidates for the rotation. For each, the walls of both maps are counted along x and
along y, and the correlation of these counts gives the shift along each axis. There is no search and no iteration. The
acceptance index chooses among the candidates.

Choices of this project: Both maps are first rotated until the target's main direction is an axis, so that straight
walls have peaks in the projections. Several peaks along each axis are combined. The score of a candidate is the number
of agreeing cells less a multiple of the disagreeing cells, since the index alone prefers maps that hardly overlap. The
best few candidates are refined by hill climbing, since a bin of half a degree is a long way at the far end of a map.
"""

import itertools

import numpy as np

from merging.alignment import Alignment
from merging.baselines.cell_states import IS_WALL, CellStates, Points, Reals
from merging.baselines.placing import BINS, Agreement, Placing, climb, hough_spectrum, judged_alignment, likely_turns
from merging.config import MergeConfig
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray

_BEST = 8  # number of candidates that are refined


def align(target: TbmGrid, source: TbmGrid, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame; both have known cells."""
    settings = config.baselines.carpin
    maps = CellStates.of(target), CellStates.of(source)
    walls = [cells.some(cells.states == IS_WALL) for cells in maps]
    if min(len(points) for points in walls) == 0:
        return Alignment("carpin", accepted=False, reason="a map has no walls")
    placing = Placing.of(*maps)
    cell = target.geometry.resolution
    fixed, moving = walls[0] - placing.target_centre, walls[1] - placing.source_centre
    spectra = [hough_spectrum(points, np.ones(len(points)), cell) for points in (fixed, moving)]
    axis = np.pi * float(spectra[0].argmax()) / BINS
    candidates = [
        (shift.real, shift.imag, turn)
        for turn in likely_turns(spectra[0], spectra[1], settings.turns)
        for shift in _shifts(fixed * np.exp(-1j * axis), moving * np.exp(1j * (turn - axis)), cell, settings.peaks)
        * np.exp(1j * axis)
    ]

    def score(places: FloatArray) -> FloatArray:
        agreement = Agreement.of(*maps, placing, places, 1500)
        return agreement.agreeing - settings.penalty * agreement.disagreeing

    places = np.array(candidates)
    best = places[np.argsort(-score(places), kind="stable")[:_BEST]]
    best = climb(score, best, 4.0 * cell, np.pi / BINS)
    place = best[score(best).argmax()]
    index = float(Agreement.of(*maps, placing, place[None]).index()[0])
    criterion = f"acceptance index {index:.3f}, accepted up to {settings.max_index:g}"
    return judged_alignment("carpin", maps, placing, place, (criterion, index <= settings.max_index), config)


def _shifts(fixed: Points, moving: Points, cell: float, peaks: int) -> Points:
    """Return shifts (peaks^2,) at which the walls' counts along x and those along y correlate most."""
    along = [
        _shifts_along(axis, other, cell, peaks)
        for axis, other in ((fixed.real, moving.real), (fixed.imag, moving.imag))
    ]
    return np.array([complex(x, y) for x, y in itertools.product(*along)])


def _shifts_along(fixed: Reals, moving: Reals, cell: float, peaks: int) -> FloatArray:
    low = float(min(fixed.min(), moving.min()))
    size = round((max(fixed.max(), moving.max()) - low) / cell) + 2
    counts = [
        np.bincount(np.floor((values - low) / cell).astype(np.intp), minlength=size) for values in (fixed, moving)
    ]
    spectra = [np.fft.rfft(count - count.mean(), 2 * size) for count in counts]
    correlation = np.fft.irfft(spectra[0] * np.conj(spectra[1]), 2 * size)
    around = np.stack([np.roll(correlation, step) for step in range(-4, 5)])
    maxima = np.flatnonzero(correlation == around.max(axis=0))
    best = maxima[np.argsort(-correlation[maxima], kind="stable")[:peaks]]
    return np.asarray(np.where(best < size, best, best - 2 * size) * cell, dtype=np.float64)
