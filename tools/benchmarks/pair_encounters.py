"""Encounters that the robots of a pair of maps might have had."""

import zlib

import numpy as np
import numpy.typing as npt

from merging.baselines.howard import Encounter, measured
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2, FloatArray
from tools.map_pairs.files import KnownPair

_WITHIN_M = 3.0
"""Robots that meet are no farther apart than this."""


def encounters_of(pair: KnownPair) -> list[Encounter]:
    """Let the two robots meet once, anywhere that both know as free; never where they share no place.

    The place, the headings and the error of the measurement are drawn by the pair's name: the same for every run.
    """
    if pair.T_target_source is None:
        return []
    rng = np.random.default_rng(zlib.crc32(pair.name.encode()))
    source = _centres(pair.source.grid, _free(pair.source.grid))
    shared = source[_is_free_at(pair.target.grid, pair.T_target_source.apply(source))]
    if len(shared) == 0:
        return []
    here = shared[rng.integers(len(shared))]
    near = shared[np.linalg.norm(shared - here, axis=1) <= _WITHIN_M]
    there = near[rng.integers(len(near))]
    headings = rng.uniform(-np.pi, np.pi, 2)
    T_target_robot = pair.T_target_source @ SE2(float(here[0]), float(here[1]), float(headings[0]))
    T_source_other = SE2(float(there[0]), float(there[1]), float(headings[1]))
    return [measured(T_target_robot, T_source_other, pair.T_target_source, rng)]


def _free(grid: TbmGrid) -> npt.NDArray[np.bool_]:
    return np.asarray(grid.masses[..., FREE] > grid.masses[..., OCCUPIED])


def _centres(grid: TbmGrid, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    return grid.geometry.centres_of(*np.nonzero(chosen))


def _is_free_at(grid: TbmGrid, points: FloatArray) -> npt.NDArray[np.bool_]:
    rows, cols, inside = grid.geometry.cells_at(points)
    return np.asarray(inside & _free(grid)[rows, cols])
