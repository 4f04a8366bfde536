"""Fit of the laser's angle step and range offset to the walls that it saw."""

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tbmslam.calibration.cluster_deviation import deviations_of_parts
from tbmslam.calibration.self_calibration import LaserFitConfig, SelfCalibration
from tbmslam.geometry.se2 import FloatArray, path_lengths
from tbmslam.geometry.trajectory import turn_rates
from tbmslam.map.keyframes import Keyframes
from tbmslam.optimisation.config import AdjustmentConfig
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.optimisation.trajectory_segments import stretch_begins


class LaserErrors(NamedTuple):
    """Errors of a laser's description, and how well they are known."""

    scale: float
    """Share by which the angles between beams are larger than stated."""
    scale_deviation: float
    """Standard deviation of `scale`."""
    offset: float
    """What is to be added to every range [m]."""
    offset_deviation: float
    """Standard deviation of `offset` [m]."""


logger = logging.getLogger(__name__)

_SETTLED = np.array([5e-4, 2e-3])
"""No more rounds are worth it once they change the scale [1] and the offset [m] by less,"""
_OF_DEVIATION = 0.3
"""or by less than this share of how well either is known."""
_CHANCE = 2.0
"""Nor where both are within so many standard deviations of nothing."""
_FARTHEST = np.array([0.1, 0.5])
"""No laser is as wrong, in scale and offset [m], and beyond, walls fit ever better as hits are drawn into a heap."""


def fit_laser(
    keyframes: Keyframes,
    poses: FloatArray,
    steps: Sequence[MotionEdge],
    config: LaserFitConfig,
    pieces: AdjustmentConfig,
) -> LaserErrors | None:
    """Return what is wrong with a laser's description; None where too little of the drive or of the view tells it.

    Parameters
    ----------
    keyframes
        Its scans.
    poses
        Poses (K, 3) of the laser at them, after drive and walls were adjusted.
    steps
        Motions from each keyframe to the next as they were tracked.
    config, pieces
        How it is sought, and what a piece of wall is.
    """
    fans = np.diff(keyframes.offsets) * np.abs(keyframes.beams[:, 1])
    if not len(fans) or float(np.median(fans)) < config.least_fan:
        return None
    chosen = [scans for scans in _parts(poses, config, pieces) if len(scans) > 1]
    if len(chosen) < config.least_parts:
        return None
    rates = turn_rates(keyframes.stamps, poses[:, 2]) * np.sign(keyframes.beams[:, 1])
    parts = [SelfCalibration(keyframes, poses, steps, rates, scans, config, pieces) for scans in chosen]
    found = _settled(parts, config)
    if found is None:
        return None
    scale, offset, scale_deviation, offset_deviation = found.tolist()
    logger.info(
        "angles between beams fit %+.2f%% (%.2f%%) larger, ranges %+.3f m (%.3f m) longer",
        *(100.0 * scale, 100.0 * scale_deviation, offset, offset_deviation),
    )
    return LaserErrors(scale, scale_deviation, offset, offset_deviation)


def _settled(parts: Sequence[SelfCalibration], config: LaserFitConfig) -> FloatArray | None:
    """Return what parts tell together, see `_joined`, once it hardly changes; None where it goes astray."""
    before, notable = np.full(2, np.inf), np.array([config.notable_scale, config.notable_offset])
    for _ in range(config.rounds):
        found = _joined([part.improved() for part in parts])
        numbers, deviations = found[:2], found[2:]
        if (np.abs(numbers) > _FARTHEST).any():
            return None
        is_nothing = (np.abs(numbers) < np.maximum(notable, _CHANCE * deviations)).all()
        if is_nothing or (np.abs(numbers - before) < np.maximum(_SETTLED, _OF_DEVIATION * deviations)).all():
            return found
        before = numbers
    return None


def _parts(poses: FloatArray, config: LaserFitConfig, pieces: AdjustmentConfig) -> list[npt.NDArray[np.int64]]:
    """Return the scans of each part: one for each stretch of it, as scans within a stretch tell the same."""
    way = path_lengths(poses)
    count = min(int(way[-1] / config.shortest), config.most_parts)
    if count < config.least_parts:
        return []
    scans = stretch_begins(poses, pieces)
    begins = np.linspace(0.0, way[-1], count + 1)[:-1]
    ends = begins + min(way[-1] / count, config.longest)
    return [scans[(way[scans] >= begin) & (way[scans] < end)] for begin, end in zip(begins, ends, strict=True)]


def _joined(told: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the scale and the offset (4,) on which parts agree best, and the standard deviation of both."""
    values, informations = (np.array(some) for some in zip(*told, strict=True))
    mean = np.linalg.solve(informations.sum(axis=0), np.einsum("pij,pj->i", informations, values))
    return np.concatenate((mean[:2], deviations_of_parts(values, informations, mean)[:2]))
