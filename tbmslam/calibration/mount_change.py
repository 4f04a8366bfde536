"""Whether the laser was turned on its robot during the drive, as by a knock, when, and by how much.

Odometry and scans determine the mount (see `tbmslam.calibration.hand_eye`) before and after each moment. Where two
places explain the motions best, the likelihood ratio is largest (D. Hinkley, "Inference about the change-point in a
sequence of random variables", Biometrika 1970). The laser was turned there only where scans say that it turned by as
much at that moment while the wheels did not: wheels that slip do not turn what the laser sees.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tbmslam.calibration.cluster_deviation import deviations_of_parts
from tbmslam.calibration.hand_eye import FREE, LEAST_ERROR, Motions, motions_of, solved
from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.kernels import IntArray

_PARTS, _LEAST = 3, 4
"""Parts of the way before and of the way after that tell the turn each by itself, and motions that each must have."""
_ROUNDS = 3
_MAYBE = 0.5
"""Share of the smallest turn worth a warning below which a moment is not looked at any closer."""
_DEPTH = 2
"""Levels of parts of parts: three knocks are told at the most."""
_LOOKED_AT = 64
"""Moments of a part that are looked at first."""
_SURE = 4.0
"""Standard deviations that the smallest turn worth a warning must be, or else the turn is not known."""


class MountChange(NamedTuple):
    """A turn of the laser on its robot.

    Parameters
    ----------
    keyframe
        The first keyframe after it.
    turn
        How far it was turned to the left [rad].
    """

    keyframe: int
    turn: float


def mount_changes(stamps: FloatArray, odometry: FloatArray, sensors: FloatArray, least: float) -> list[MountChange]:
    """Return when the laser was turned on its robot, in the order of the drive.

    Parameters
    ----------
    stamps, odometry, sensors
        Times (K,) [s], poses (K, 3) of the robot by odometry, nan where there was none, and of the laser in the map.
    least
        Smallest turn that counts [rad].
    """
    if len(stamps) < 2:
        return []
    motions = motions_of(stamps, odometry, sensors)
    splits, known = _splits(motions, least, _DEPTH), dict[tuple[int, int], tuple[float, float]]()
    while splits:
        edges = [0, *splits, len(motions.sides)]
        for part in pairwise(edges):
            if part not in known:
                known[part] = _turn(_some(motions, slice(*part)))
        turns = [_turned(known[before], known[after]) for before, after in pairwise(pairwise(edges))]
        knocks = [
            _knocked_at(motions.ends[:, split - 1 : split + 1], odometry, sensors, turn, least)
            if abs(turn) > least > sure
            else None
            for split, (turn, sure) in zip(splits, turns, strict=True)
        ]
        doubtful = [number for number, keyframe in enumerate(knocks) if keyframe is None]
        if not doubtful:
            found = zip(knocks, turns, strict=True)
            return [MountChange(int(keyframe), turn) for keyframe, (turn, _) in found if keyframe is not None]
        del splits[min(doubtful, key=lambda number: abs(turns[number][0]))]  # its parts are one, which tells more
    return []


def _splits(motions: Motions, least: float, depth: int) -> list[int]:
    """Return before which motions the place may have changed by `least` [rad]; parts are parted `depth` times."""
    found = _split(motions) if depth else None
    if found is None:
        return []
    split, turn = found
    before = _splits(_some(motions, slice(0, split)), least, depth - 1)
    after = _splits(_some(motions, slice(split, None)), least, depth - 1)
    return [*before, *([split] if abs(turn) > _MAYBE * least else []), *(split + later for later in after)]


def _some(motions: Motions, part: slice) -> Motions:
    return Motions(motions.ends[:, part], motions.slopes[part], motions.sides[part])


def _split(motions: Motions) -> tuple[int, float] | None:
    """Return before which motion the place changed if it did, and by which turn [rad]; None where there are too few."""
    slopes, sides = motions.slopes, motions.sides
    count, least = len(sides), _PARTS * _LEAST
    if count < 2 * least:
        return None
    apart = max((count - 2 * least) // _LOOKED_AT, 1)
    split, turn, weights = 0, 0.0, np.ones(count)
    for _ in range(_ROUNDS):
        weighted = np.swapaxes(slopes, 1, 2) * weights[:, None, None]
        curvatures = np.cumsum(weighted @ slopes, axis=0)
        pulls = np.cumsum((weighted @ sides[:, :, None])[:, :, 0], axis=0)
        # The likelihood changes slowly from motion to motion: here and there first, then all about the best.
        roughly = _best_split(curvatures, pulls, np.arange(least, count - least + 1, apart))[0]
        nearby = np.arange(max(roughly - apart, least), min(roughly + apart, count - least) + 1)
        split, before, after = _best_split(curvatures, pulls, nearby)
        turn = math.remainder(_angle(after) - _angle(before), math.tau)
        places = np.where((np.arange(count) < split)[:, None], before, after)
        weights = _weights(np.hypot(*(sides - (slopes @ places[:, :, None])[:, :, 0]).T))[0]
    return split, turn


def _best_split(curvatures: FloatArray, pulls: FloatArray, splits: IntArray) -> tuple[int, FloatArray, FloatArray]:
    """Return which of splits (S,) explains the motions best, and the place (5,) before it and after it.

    Curvatures (M, 5, 5) and pulls (M, 5) are summed up to each motion.
    """
    before, after = curvatures[splits - 1], curvatures[-1] - curvatures[splits - 1]
    pulls_before, pulls_after = pulls[splits - 1], pulls[-1] - pulls[splits - 1]
    places_before = np.linalg.solve(before + FREE, pulls_before[:, :, None])[:, :, 0]
    places_after = np.linalg.solve(after + FREE, pulls_after[:, :, None])[:, :, 0]
    gains = np.einsum("sj,sj->s", pulls_before, places_before) + np.einsum("sj,sj->s", pulls_after, places_after)
    best = int(gains.argmax())
    return int(splits[best]), places_before[best], places_after[best]


def _turned(before: tuple[float, float], after: tuple[float, float]) -> tuple[float, float]:
    """Return by how much a laser is turned between two parts, and how large a turn would be known for sure [rad]."""
    return math.remainder(after[0] - before[0], math.tau), _SURE * math.hypot(before[1], after[1])


def _turn(motions: Motions) -> tuple[float, float]:
    """Return the laser's turn on the robot and its standard deviation [rad]."""
    slopes, sides = motions.slopes, motions.sides
    whole, _ = solved(slopes, sides)
    weights, error = _weights(np.linalg.norm(sides - slopes @ whole, axis=1))
    informations, values = [], []
    for part in np.array_split(np.arange(len(sides)), _PARTS):
        weighted = weights[part, None, None] * slopes[part]
        curvature = np.tensordot(weighted, slopes[part], axes=((0, 1), (0, 1))) + FREE
        values.append(np.linalg.solve(curvature, np.tensordot(weighted, sides[part], axes=((0, 1), (0, 1)))))
        informations.append(curvature / error**2)
    deviations = deviations_of_parts(np.array(values), np.array(informations), whole)
    return _angle(whole), float(max(deviations[2:4])) / max(math.hypot(whole[2], whole[3]), 1e-6)


def _angle(place: FloatArray) -> float:
    """Return the turn of a place (5,) [rad]."""
    return math.atan2(place[3], place[2])


def _weights(errors: FloatArray) -> tuple[FloatArray, float]:
    """Return the weights of motions by their errors (M,) [m], and the error of most."""
    error = max(1.48 * float(np.median(errors)), LEAST_ERROR)
    weights: FloatArray = 1.0 / (1.0 + (errors / (2.0 * error)) ** 2)
    return weights, error


def _knocked_at(ends: IntArray, odometry: FloatArray, sensors: FloatArray, turn: float, least: float) -> int | None:
    """Return at which keyframe, from the begin of one motion to the end of the next, the scans turned by themselves.

    Scans and odometry may differ there by less than `least` [rad] more or less; None where they do nowhere.
    """
    first, last = int(ends[0, 0]), int(ends[1, -1])
    seen = np.diff(sensors[first : last + 1, 2])
    wheels = np.diff(odometry[first : last + 1, 2])
    astray = np.abs(wrap_angles(seen - wheels - turn))
    if np.isnan(astray).all():
        return None
    nearest = int(np.nanargmin(astray))
    return first + nearest + 1 if astray[nearest] < least else None
