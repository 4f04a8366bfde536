"""What the aligned maps say about each other, for and against."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.config.verification import VerificationConfig
from merging.verification.see_through import seen_through_m
from merging.verification.wall_segments import Pieces, count_pieces
from merging.walls.wall_map import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.map.walls import AGREED, COMPARED, CONFLICTING, SQUARES, UNSEEN, XX, XY, YY, Walls, compare

_Chosen = tuple[Walls, npt.NDArray[np.int64], float]
"""Walls, the indices of those that are looked at, and the length that each of them stands for [m]."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against an alignment.

    Lengths of wall are means of two directions, either map's walls held against the other map, and things that people
    move count little (`merging.walls.movable_objects`).

    Parameters
    ----------
    overlap_m2
        Area that both maps know [m^2].
    compared_wall_m
        Walls that lie where the other map knows something [m].
    agreed_wall_m
        Of those, the walls with a wall of the other map near by that was seen from the same side [m].
    conflicting_wall_m
        Of those, the walls that stand on the other map's free space, far from all of its walls [m].
    unseen_wall_m
        Walls whose front the other robot saw free, so that it should have seen them, and did not [m].
    weakest_wall_m
        How much of the agreeing wall resists sliding in the direction that it resists least [m].
    rmse_m
        Root mean square distance of the agreeing walls from their likes, to half a cell [m]; None where none agree.
    agreement, conflict
        Shares of the compared walls that agree with, and that stand on free space of, the other map. The rest is
        neither: near a wall but not near enough, or near one that faces another way.
    larger_wall_m
        All walls of the map that has more of them [m].
    seen_through_m
        The unbroken stretches of wall that the other robot saw through (`merging.verification.see_through`) [m].
    agreed_things_m, compared_things_m
        What people move, and lies where the other map knows something: the outlines that agree, and all [m]. Things of
        two visits seldom agree, those of one visit mostly.
    pieces
        The same by separate pieces of wall.
    """

    overlap_m2: float
    compared_wall_m: float
    agreed_wall_m: float
    conflicting_wall_m: float
    unseen_wall_m: float
    weakest_wall_m: float
    rmse_m: float | None
    agreement: float
    conflict: float
    larger_wall_m: float
    seen_through_m: float
    agreed_things_m: float
    compared_things_m: float
    pieces: Pieces


def support_m(
    target: WallMap, source: WallMap, motions: list[SE2], config: VerificationConfig, limit: int | None = None
) -> FloatArray:
    """Return how much wall (M,) speaks for each alignment, less what speaks against it [m].

    `limit` is the number of walls of each map that are held against the other; None takes all.
    """
    forth, back = _sums(target, source, motions, config, lambda one: _walls_of(one, limit))
    agreed = (forth + back)[:, AGREED]
    others = (forth + back)[:, COMPARED] - agreed + (forth + back)[:, UNSEEN]
    return np.asarray((agreed - config.other_weight * others) / 2.0)


def examine(target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig) -> Evidence:
    """Compare two maps under an alignment, each one's walls with the other map."""
    return examine_all(target, source, [T_target_source], config)[0]


def examine_all(target: WallMap, source: WallMap, motions: list[SE2], config: VerificationConfig) -> list[Evidence]:
    """Compare two maps under each of some alignments; see `examine`."""
    means = np.mean(_sums(target, source, motions, config, lambda one: _walls_of(one, None)), axis=0)
    things = np.mean(_sums(target, source, motions, config, _things_of), axis=0)
    larger_m = max(target.wall_m, source.wall_m)
    return [
        _evidence(target, source, motion, walls, movable, larger_m, config)
        for motion, walls, movable in zip(motions, means, things, strict=True)
    ]


def _walls_of(structure: WallMap, limit: int | None) -> _Chosen:
    some = structure.some(limit)
    return structure.walls, some, structure.geometry.resolution * len(structure.points) / max(len(some), 1)


def _things_of(structure: WallMap) -> _Chosen:
    return *structure.things, structure.geometry.resolution


def _sums(
    target: WallMap,
    source: WallMap,
    motions: list[SE2],
    config: VerificationConfig,
    chosen: Callable[[WallMap], _Chosen],
) -> tuple[FloatArray, FloatArray]:
    """Return the sums (M, 8) of `compare` in metres: what is chosen of the source held against the target, and back."""
    backward = [motion.inverse() for motion in motions]
    sums = []
    for moving, fixed, T_fixed_moving in ((source, target, motions), (target, source, backward)):
        walls, some, metres = chosen(moving)
        sums.append(compare(walls, some, fixed.walls, T_fixed_moving, config.limits()) * metres)
    return sums[0], sums[1]


def _evidence(
    target: WallMap,
    source: WallMap,
    motion: SE2,
    mean: FloatArray,
    things: FloatArray,
    larger_m: float,
    config: VerificationConfig,
) -> Evidence:
    compared, agreed = float(mean[COMPARED]), float(mean[AGREED])
    weakest = np.linalg.eigvalsh([[mean[XX], mean[XY]], [mean[XY], mean[YY]]])[0]
    return Evidence(
        overlap_m2=_overlap_m2(target, source, motion),
        compared_wall_m=compared,
        agreed_wall_m=agreed,
        conflicting_wall_m=float(mean[CONFLICTING]),
        unseen_wall_m=float(mean[UNSEEN]),
        weakest_wall_m=max(float(weakest), 0.0),
        rmse_m=math.sqrt(float(mean[SQUARES]) / agreed) if agreed > 0.0 else None,
        agreement=agreed / compared if compared > 0.0 else 0.0,
        conflict=float(mean[CONFLICTING]) / compared if compared > 0.0 else 0.0,
        larger_wall_m=larger_m,
        seen_through_m=seen_through_m(target, source, motion, config.see_through_m),
        agreed_things_m=float(things[AGREED]),
        compared_things_m=float(things[COMPARED]),
        pieces=count_pieces(target, source, motion, config.limits()),
    )


def _overlap_m2(target: WallMap, source: WallMap, T_target_source: SE2) -> float:
    centres, cell_m2 = source.some_known
    rows, cols, inside = target.geometry.cells_at(T_target_source.apply(centres))
    return float(np.count_nonzero(inside & target.known[rows, cols])) * cell_m2
