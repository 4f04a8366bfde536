"""Is this alignment true? What the aligned maps say about each other."""

import math
from dataclasses import dataclass

import numpy as np

from merging.config import VerificationConfig
from merging.structure import FACING, Structure, alignment_of_normals
from tbmslam.se2 import SE2, FloatArray


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against an alignment.

    Parameters
    ----------
    overlap_m2
        Area that both maps know [m^2].
    compared_wall_m
        Walls of either map that lie where the other map knows something, mean of the two directions [m].
    agreed_wall_m
        Of those, the walls with a wall of the other map near by that was seen from the same side [m].
    weakest_wall_m
        How much of the agreeing wall resists sliding in the direction that it resists least [m].
    rmse_m
        Root mean square distance of the agreeing walls from their likes, to half a cell [m]; None where none agree.
    agreement, conflict
        Shares of the compared walls that agree with, and that stand on free space of, the other map. The rest is
        neither: near a wall but not near enough, or near one that faces another way.
    """

    overlap_m2: float
    compared_wall_m: float
    agreed_wall_m: float
    weakest_wall_m: float
    rmse_m: float | None
    agreement: float
    conflict: float


def support_m(
    target: Structure, source: Structure, T_target_source: SE2, config: VerificationConfig, limit: int | None = None
) -> float:
    """Return how much wall speaks for an alignment, less what speaks against it [m]; `limit` as in `refine`."""
    forth = _Comparison.of(source, target, T_target_source, config, limit)
    back = _Comparison.of(target, source, T_target_source.inverse(), config, limit)
    agreed, conflicting = forth.agreed_m + back.agreed_m, forth.conflicting_m + back.conflicting_m
    return (agreed - config.conflict_weight * conflicting) / 2.0


def examine(target: Structure, source: Structure, T_target_source: SE2, config: VerificationConfig) -> Evidence:
    """Compare two maps under an alignment, each one's walls with the other map."""
    forth = _Comparison.of(source, target, T_target_source, config, None)
    back = _Comparison.of(target, source, T_target_source.inverse(), config, None)
    compared, agreed = (forth.compared_m + back.compared_m) / 2.0, (forth.agreed_m + back.agreed_m) / 2.0
    conflicting = (forth.conflicting_m + back.conflicting_m) / 2.0
    return Evidence(
        overlap_m2=_overlap_m2(target, source, T_target_source),
        compared_wall_m=compared,
        agreed_wall_m=agreed,
        weakest_wall_m=min(forth.weakest_m, back.weakest_m),
        rmse_m=math.sqrt((forth.squares_m3 + back.squares_m3) / 2.0 / agreed) if agreed > 0.0 else None,
        agreement=agreed / compared if compared > 0.0 else 0.0,
        conflict=conflicting / compared if compared > 0.0 else 0.0,
    )


def objection(evidence: Evidence, config: VerificationConfig) -> str | None:
    """Return why an alignment cannot be believed, with the numbers; None where nothing speaks against it."""
    beyond_chance = evidence.weakest_wall_m >= config.bent_weakest_wall_m
    max_conflict = config.max_conflict_bent if beyond_chance else config.max_conflict
    checks = (
        (
            evidence.overlap_m2 >= config.min_overlap_m2,
            "overlap of {0.overlap_m2:.1f} m2 is under {1.min_overlap_m2:g} m2",
        ),
        (
            evidence.conflict <= max_conflict,
            "{0.conflict:.0%} of the walls in the overlap stand on free space of the other, over {2:.0%}",
        ),
        (
            evidence.agreed_wall_m >= config.min_agreed_wall_m,
            "only {0.agreed_wall_m:.1f} m of wall agree, under {1.min_agreed_wall_m:g} m",
        ),
        (
            evidence.agreement >= config.min_agreement,
            "only {0.agreement:.0%} of the walls in the overlap agree, under {1.min_agreement:.0%}",
        ),
        (
            evidence.weakest_wall_m >= config.min_weakest_wall_m,
            "the maps could slide: only {0.weakest_wall_m:.1f} m of wall resist, under {1.min_weakest_wall_m:g} m",
        ),
    )
    return next((text.format(evidence, config, max_conflict) for holds, text in checks if not holds), None)


@dataclass(frozen=True)
class _Comparison:
    """The walls of one map held against another map; lengths in metres."""

    compared_m: float
    agreed_m: float
    conflicting_m: float
    weakest_m: float
    squares_m3: float  # squared distances of the agreeing walls, each times the wall's length

    @classmethod
    def of(
        cls, walls: Structure, other: Structure, T_other_walls: SE2, config: VerificationConfig, limit: int | None
    ) -> "_Comparison":
        some = walls.some(limit)
        rows, cols, inside = other.cells_of(T_other_walls.apply(walls.points[some]))
        if not inside.any() or len(other.points) == 0:
            return cls(0.0, 0.0, 0.0, 0.0, 0.0)
        distances = np.where(inside, other.distances_m[rows, cols], np.inf)
        normals = SE2(0.0, 0.0, T_other_walls.theta).apply(walls.normals[some])
        nearest = other.nearest[rows, cols]
        facing = alignment_of_normals(normals, walls.two_sided[some], other.normals[nearest], other.two_sided[nearest])
        agreed = (distances <= config.agreement_distance_m) & (facing >= FACING)
        compared = agreed | (inside & other.known[rows, cols])
        conflicting = compared & other.free[rows, cols] & (distances > config.conflict_distance_m)
        step = walls.geometry.resolution * len(walls.points) / len(some)
        return cls(
            float(compared.sum() * step),
            float(agreed.sum() * step),
            float(conflicting.sum() * step),
            _weakest(normals[agreed]) * step,
            float((distances[agreed] ** 2).sum() * step),
        )


def _weakest(normals: FloatArray) -> float:
    """Return the smallest eigenvalue of the normals' scatter: the weight against a slide in the worst direction."""
    return float(np.linalg.eigvalsh(normals.T @ normals)[0])


def _overlap_m2(target: Structure, source: Structure, T_target_source: SE2) -> float:
    rows, cols = np.nonzero(source.known)
    step = source.geometry.resolution
    centres = np.column_stack(
        (source.geometry.origin_x + (cols + 0.5) * step, source.geometry.origin_y + (rows + 0.5) * step)
    )
    rows, cols, inside = target.cells_of(T_target_source.apply(centres))
    return float(np.count_nonzero(inside & target.known[rows, cols]) * step**2)
