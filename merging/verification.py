"""The evidence for and against a pose hypothesis: lengths of wall that agree and conflict.

The cells of one straight wall are not independent: a long wall lies on other walls by chance as easily as a short one.
Therefore walls are also counted by square blocks of the floor (`Pieces`), where each block counts once, and by corners.
Unbroken stretches of wall that the other robot saw through are measured separately: similar places share many
walls, but one of them often has a wall where the other has free space.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from merging.config.registration import VerificationConfig
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray, IntArray
from tbmslam.kernels.grids.walls import (
    AGREED,
    AGREES,
    COMPARED,
    CONFLICTING,
    CONFLICTS,
    NOT_SEEN,
    OUTSIDE,
    SQUARES,
    UNSEEN,
    XX,
    XY,
    YY,
    Limits,
    Walls,
    classify_walls,
    compare_walls,
    see_through_walls,
)
from tbmslam.kernels.search.connected_cells import components_of

Cells = IntArray
_Chosen = tuple[Walls, IntArray, float]
"""Walls, the indices of those that are compared, and the length that each of them represents [m]."""

_BLOCK_M = 1.0
"""Side of a block of the floor."""
_ENOUGH_M = 0.3
"""Length of wall from which a block counts fully."""
MANY_WALLS = 4000
"""Most wall cells of a map that are compared for its blocks, or for a covariance."""
_DOOR_M = 0.8
"""Length of a door leaf; a shorter stretch of wall may be a door or a movable object."""
_CORNERS = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
"""Rows and columns of the corners of a cell that is grown by one all around."""
_TOUCHING = 3
"""Largest distance of two cells along rows and columns that touch once both are grown by one."""


@dataclass(frozen=True)
class Pieces:
    """Numbers of blocks, each the mean of both directions of the comparison."""

    agreeing: float
    conflicting: float
    """Shares of the walls that agree and that conflict, summed over the blocks."""
    compared: float
    """Blocks with walls in the known area of the other map."""
    corners: float
    """Blocks with agreeing walls of different directions."""


@dataclass(frozen=True)
class Evidence:
    """The evidence for and against an alignment.

    Each length is the mean of two directions: the walls of each map are compared with the other map. Movable objects
    have little weight (`merging.walls`).
    """

    overlap_m2: float
    """Area known to both maps [m^2]."""
    compared_wall_m: float
    """Walls in the known area of the other map [m]."""
    agreed_wall_m: float
    """Compared walls near a wall of the other map that faces the same way [m]."""
    conflicting_wall_m: float
    """Compared walls on free space of the other map, far from all of its walls [m]."""
    unseen_wall_m: float
    """Walls that the other robot did not see although it saw free space in front of them [m]."""
    weakest_wall_m: float
    """Length of agreeing wall that resists a shift in the least constrained direction [m]."""
    rmse_m: float | None
    """Root mean square distance between agreeing walls, to half a cell [m]; None if none agree."""
    agreement: float
    conflict: float
    """Shares of the compared walls that agree and that conflict. The rest is near a wall, but not near enough, or faces
    another way."""
    larger_wall_m: float
    """Length of all walls of the map with more walls [m]."""
    seen_through_m: float
    """Unbroken stretches of wall that the other robot saw through [m]."""
    agreed_things_m: float
    compared_things_m: float
    """Outlines of movable objects in the known area of the other map: those that agree, and all [m]. They mostly agree
    within one visit and seldom between two."""
    pieces: Pieces
    """The evidence by blocks of the floor."""


def support_m(
    target: WallMap, source: WallMap, motions: list[SE2], config: VerificationConfig, limit: int | None = None
) -> FloatArray:
    """Return the length of wall (M,) that supports each alignment, less the weighted length of all other walls [m].

    `limit` is the number of wall cells of each map that are compared; None compares all.
    """
    forth, back = _sums(target, source, motions, config, lambda one: _walls_of(one, limit))
    agreed = (forth + back)[:, AGREED]
    others = (forth + back)[:, COMPARED] - agreed + (forth + back)[:, UNSEEN]
    return np.asarray((agreed - config.other_weight * others) / 2.0)


def compared_and_agreed_m(
    target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig
) -> tuple[float, float]:
    """Return the lengths of compared and of agreeing walls of `Evidence`, without the other evidence [m]."""
    sums = np.mean(_sums(target, source, [T_target_source], config, lambda one: _walls_of(one, None)), axis=0)[0]
    return float(sums[COMPARED]), float(sums[AGREED])


def examine(target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig) -> Evidence:
    """Compare the walls of each map with the other map under an alignment."""
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
    """Return the sums (M, 8) of `compare_walls` in metres: the source against the target, and vice versa."""
    backward = [motion.inverse() for motion in motions]
    sums = []
    for moving, fixed, T_fixed_moving in ((source, target, motions), (target, source, backward)):
        walls, some, metres = chosen(moving)
        poses = np.array(T_fixed_moving, dtype=np.float64).reshape(-1, 3)
        sums.append(compare_walls(walls, some, fixed.walls, poses, config.limits()) * metres)
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
    return float(np.count_nonzero(target.knows(T_target_source.apply(centres)))) * cell_m2


def count_pieces(target: WallMap, source: WallMap, T_target_source: SE2, limits: Limits) -> Pieces:
    """Count the blocks with walls that agree and that conflict under an alignment."""
    forth = _counts(source, target, T_target_source, limits)
    back = _counts(target, source, T_target_source.inverse(), limits)
    agreeing, conflicting, compared, corners = ((forth + back) / 2.0).tolist()
    return Pieces(agreeing, conflicting, compared, corners)


def _counts(moving: WallMap, fixed: WallMap, motion: SE2, limits: Limits) -> FloatArray:
    some = moving.some(MANY_WALLS)
    held = classify_walls(moving.walls, some, fixed.walls, motion, limits)
    there = (held != OUTSIDE) & (held != NOT_SEEN)
    if not there.any():
        return np.zeros(4)
    some, held = some[there], held[there]
    cell_m = moving.geometry.resolution * (len(moving.points) / len(there))
    metres = cell_m * moving.weights[some]
    blocks = _blocks(motion.apply(moving.points[some]))
    normals = SE2(0.0, 0.0, motion.theta).apply(moving.normals[some])
    agreed = metres * (held == AGREES)
    xx, xy, yy = (np.bincount(blocks, agreed * normals[:, i] * normals[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    weakest = (xx + yy) / 2.0 - np.hypot((xx - yy) / 2.0, xy)
    compared = np.bincount(blocks, metres)
    shares = [
        np.bincount(blocks, part) / np.maximum(compared, _ENOUGH_M) for part in (agreed, metres * (held == CONFLICTS))
    ]
    whole = [np.minimum(part / _ENOUGH_M, 1.0) for part in (compared, weakest)]
    return np.array([part.sum() for part in (*shares, *whole)])


def _blocks(points: FloatArray) -> IntArray:
    """Return the number of the block that each point (N, 2) lies in."""
    cells = np.floor((points - points.min(axis=0)) / _BLOCK_M).astype(np.int64)
    return np.asarray(cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1])


def seen_through_m(target: WallMap, source: WallMap, T_target_source: SE2, reach_m: float) -> float:
    """Return the length of unbroken stretches of wall that the other robot saw through, a mean of two directions [m].

    Of each stretch only the length beyond a door leaf counts. The other map must be free within `reach_m` before and
    behind the wall [m], which is larger than the distance of doubled walls in distorted maps.
    """
    forth = _stretches_m(source, target, T_target_source, reach_m)
    return (forth + _stretches_m(target, source, T_target_source.inverse(), reach_m)) / 2.0


def _stretches_m(moving: WallMap, fixed: WallMap, motion: SE2, reach_m: float) -> float:
    through = see_through_walls(moving.walls, fixed.walls, motion, reach_m) & (moving.weights >= 1.0)
    rows, cols, _ = moving.geometry.cells_at(moving.points[through])
    return stretches_m(np.column_stack((rows, cols)), moving.geometry.resolution)


def stretches_m(cells: Cells, resolution: float) -> float:
    """Return the sum of the lengths of stretches of wall cells (N, 2) beyond a door leaf [m].

    Each cell is grown by one all around before, which closes the gaps of ragged walls.
    """
    if len(cells) == 0:
        return 0.0
    pieces = _large_pieces(cells - cells.min(axis=0), resolution)
    lengths = {_place_of(piece): _longer_m(piece, resolution) for piece in pieces}
    return sum(lengths[place] for place in sorted(lengths))


def _large_pieces(cells: Cells, resolution: float) -> list[Cells]:
    """Return the cells (N, 2) of each connected piece after growth, without small pieces."""
    cells = np.ascontiguousarray(cells[np.lexsort((cells[:, 1], cells[:, 0]))])
    labels = components_of(cells, _TOUCHING)
    order = np.argsort(labels, kind="stable")
    cells, starts = cells[order], np.flatnonzero(np.diff(labels[order], prepend=-1))
    sides = np.maximum.reduceat(cells, starts) - np.minimum.reduceat(cells, starts) + 3  # grown
    large = np.hypot(*sides.T) * resolution > _DOOR_M
    return [piece for piece, is_large in zip(np.split(cells, starts[1:]), large, strict=True) if is_large]


def _place_of(piece: Cells) -> tuple[int, int]:
    """Return the block of two by two cells in which a grown piece begins. It fixes the order of the sum of lengths."""
    row = int(piece[:, 0].min()) // 2
    return row, int(piece[piece[:, 0] <= 2 * row + 1, 1].min()) // 2


def _longer_m(piece: Cells, resolution: float) -> float:
    """Return the length of a piece beyond a door leaf [m], without the cell by which it was grown."""
    # The rectangle around the corners of the grown cells is that around all of their cells.
    corners = (piece[:, None] + _CORNERS).reshape(-1, 2)[:, ::-1]
    _, sides, _ = cv2.minAreaRect(corners.astype(np.float32))
    return max(float(max(sides)) * resolution - resolution - _DOOR_M, 0.0)
