"""The pose of one map in the frame of another with its covariance, or the reason why it is unknown.

The covariance follows from the walls that agree. A wall constrains a map across the wall and not along it; distant
walls constrain the rotation. Maps are distorted over metres, so one metre of wall counts as one measurement, whatever
its number of cells. In the frame of the source, at the centroid of the agreeing walls::

    covariance = inverse(sum over walls of metres * J' J / wall^2 + prior) + bend^2,    J = (nx, ny, x ny - y nx)

with normals n at points (x, y). The parameters were fitted to the errors on `data/map-pairs` and on pairs cut from
other maps; `tools/benchmark.py align` measures the calibration. Real drives are also bent as a whole, by some tenths of
a degree.
"""

import base64
import html
import math
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property

import numpy as np

from merging.config.registration import ExactnessConfig
from merging.pair_picture import CAPTION, ComparedGrids
from merging.verification import MANY_WALLS, Evidence
from merging.walls import WallMap
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.grids.walls import AGREES, Limits, classify_walls

Covariance = tuple[tuple[float, ...], ...]
"""Covariance of an error in x, y [m] and theta [rad] in the source's frame, three rows of three."""

Pair = tuple[str, str]
"""The names of a target and a source map."""


_SURE = 0.999
"""Largest probability of a hypothesis; the smallest is 1 minus this."""


@dataclass(frozen=True)
class PoseHypothesis:
    """A pose that the source map may have in the target's frame."""

    T_target_source: SE2
    """Pose of the source's frame in the target's frame."""
    confidence: float
    """Probability that it is right."""
    agreed_wall_m: float
    """Length of the walls that agree there [m]."""
    covariance: Covariance | None = None
    """How exact the pose is if it is right; None if it is not known."""
    accepted: bool = False
    """Whether it is the pose of an accepted alignment."""

    @cached_property
    def log_odds(self) -> float:
        """Log odds that it is right."""
        p = min(max(self.confidence, 1.0 - _SURE), _SURE)
        return math.log(p / (1.0 - p))

    def reversed(self) -> "PoseHypothesis":
        """Return the pose of the target in the source's frame."""
        covariance = _reversed(self.covariance, self.T_target_source)
        return replace(self, T_target_source=self.T_target_source.inverse(), covariance=covariance)


@dataclass(frozen=True, repr=False)
class Alignment:
    """The pose of a source map in the frame of a target map, or the reason why it is unknown.

    If the pair is refused, `accepted` is False, `reason` says why, and the transform is the refused pose, if there is
    one. It is never the identity by default.

    Parameters
    ----------
    method
        The method that found it.
    accepted
        Whether the transform may be used.
    reason
        Reason of the decision, one sentence with the numbers.
    T_target_source
        Pose of the source's frame in the target's frame.
    matches, inliers
        For `features`, number of matched keypoints and of inliers; for `correlation`, number of cells of
        wall in the overlap, and of those that agree.
    rmse_m
        Root mean square distance of the inliers [m].
    scale
        The factor that fits the inliers best, if the method estimates it; two maps in metres have 1.
    overlap_m2
        Area that both maps know [m^2].
    agreement, conflict
        Shares of the walls in the overlap that agree, and that lie in the other map's free space.
    agreed_wall_m, weakest_wall_m
        Length of the agreeing walls, and the part of it that resists a slide in the weakest direction [m].
    confidence
        Probability that the transform is right: of ten alignments with 0.9, nine are right.
    covariance
        Covariance of the transform if it is right; see the module. None if the method does not
        estimate it.
    bent_m
        RMS deformation of one of the maps [m]; 0 for a rigid alignment.
    lead
        For `correlation`, the score of the best pose divided by that of the next pose, on coarse cells; 0 if there is
        none.
    starts
        For `correlation`, the poses from which a deformation starts: the best poses, and the best rigid one if it is
        likely enough; each of the map with less wall in the frame of the other map.
    decoys
        For `correlation`, the evidence for the best poses of the source's mirror image, at most three: what chance
        achieves.
    ambiguous
        Whether it was refused because the maps fit well at several poses.
    alternatives
        Other likely poses, the most likely first.
    evidence
        The evidence for and against it; None if there is no transform.
    compared
        The grids for the picture in a notebook; None if they were not kept.
    """

    method: str
    accepted: bool
    reason: str
    T_target_source: SE2 | None = None
    matches: int = 0
    inliers: int = 0
    rmse_m: float | None = None
    scale: float | None = None
    overlap_m2: float = 0.0
    agreement: float = 0.0
    conflict: float = 0.0
    agreed_wall_m: float = 0.0
    weakest_wall_m: float = 0.0
    confidence: float = 0.0
    covariance: Covariance | None = None
    bent_m: float = 0.0
    lead: float = 0.0
    starts: tuple[SE2, ...] = ()
    decoys: tuple[Evidence, ...] = ()
    ambiguous: bool = False
    alternatives: tuple[PoseHypothesis, ...] = ()
    evidence: Evidence | None = None
    compared: ComparedGrids | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        """Return one line: the pose of the source in the target's frame, and the reason."""
        verdict = "accepted" if self.accepted else "refused"
        if self.T_target_source is None:
            return f"Alignment({verdict}: {self.reason})"
        x, y, degrees = format_pose(self.T_target_source)
        return f"Alignment({verdict}, x {x} m, y {y} m, turned {degrees} degrees: {self.reason})"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: decision, confidence and reason, and the walls of both maps at the pose."""
        verdict, place = ("Accepted" if self.accepted else "Refused"), ""
        if self.T_target_source is not None:
            x, y, degrees = format_pose(self.T_target_source)
            place = f" The source lies at x {x} m, y {y} m, turned {degrees}°, in the frame of the target."
        text = f"<p><b>{verdict}, confidence {html.escape(format_confidence(self.confidence))}.</b>{place}</p>"
        text += f"<p>{html.escape(self.reason[:1].upper() + self.reason[1:])}.</p>"
        return text + self.picture_html("the target", "the source")

    def picture_html(self, target: str, source: str) -> str:
        """Return the walls of both maps at the pose with a caption that names the maps; empty if there is no pose."""
        if self.T_target_source is None or self.compared is None:
            return ""
        data = base64.b64encode(self.compared.png(self.T_target_source)).decode("ascii")
        caption = CAPTION.format(target=html.escape(target), source=html.escape(source))
        below = f"{caption} {self.compared.note}".rstrip()
        return f'<img alt="{caption}" src="data:image/png;base64,{data}"><p><small>{below}</small></p>'

    def at(self, T_target_source: SE2, evidence: Evidence, confidence: float, covariance: Covariance) -> "Alignment":
        """Return the alignment with a pose, its evidence, probability and covariance."""
        return replace(
            self,
            T_target_source=T_target_source,
            overlap_m2=evidence.overlap_m2,
            agreement=evidence.agreement,
            conflict=evidence.conflict,
            agreed_wall_m=evidence.agreed_wall_m,
            weakest_wall_m=evidence.weakest_wall_m,
            confidence=confidence,
            covariance=covariance,
            evidence=evidence,
        )

    def reversed(self) -> "Alignment":
        """Return the pose of the target in the source's frame."""
        if self.T_target_source is None:
            return self
        covariance = _reversed(self.covariance, self.T_target_source)
        alternatives = tuple(hypothesis.reversed() for hypothesis in self.alternatives)
        return replace(
            self,
            T_target_source=self.T_target_source.inverse(),
            covariance=covariance,
            alternatives=alternatives,
            compared=None if self.compared is None else self.compared.reversed(),
        )

    def hypotheses(self) -> tuple[PoseHypothesis, ...]:
        """Return the pose of the alignment and its alternatives; none if there is no pose."""
        if self.T_target_source is None:
            return ()
        best = PoseHypothesis(
            self.T_target_source, self.confidence, self.agreed_wall_m, self.covariance, accepted=self.accepted
        )
        return (best, *self.alternatives)

    def matched_by_walls(self, evidence: Evidence, resolution: float) -> "Alignment":
        """Return the alignment of a method whose matches are cells of wall, with the size of a cell [m]."""
        return replace(
            self,
            matches=round(evidence.compared_wall_m / resolution),
            inliers=round(evidence.agreed_wall_m / resolution),
            rmse_m=evidence.rmse_m,
        )

    def as_json(self) -> dict[str, object]:
        """Return the fields as JSON can hold them; transforms as [x m, y m, theta rad] or None."""
        values = asdict(replace(self, compared=None))  # `asdict` would copy the grids
        del values["starts"], values["decoys"], values["compared"]
        values["T_target_source"] = None if self.T_target_source is None else list(self.T_target_source)
        # The scale is not a number if all inliers lie at one point.
        values["scale"] = self.scale if self.scale is not None and math.isfinite(self.scale) else None
        for alternative in values["alternatives"]:
            alternative["T_target_source"] = list(alternative["T_target_source"])
            del alternative["accepted"]  # an alternative is never accepted
        return values


def _reversed(covariance: Covariance | None, T_target_source: SE2) -> Covariance | None:
    return None if covariance is None else seen_from(covariance, T_target_source)


def format_confidence(confidence: float) -> str:
    """Return a probability with three decimals, never rounded up to certainty."""
    return "> 0.999" if confidence >= 0.9995 else f"{confidence:.3f}"


def format_pose(pose: SE2 | None) -> tuple[str, str, str]:
    """Return x [m], y [m] and theta [deg]; dashes if there is no pose."""
    if pose is None:
        return "–", "–", "–"
    x, y, degrees = round(pose.x, 3), round(pose.y, 3), round(math.degrees(wrap_angle(pose.theta)), 2)
    return f"{x + 0.0:.3f}", f"{y + 0.0:.3f}", f"{degrees + 0.0:.2f}"  # adding zero takes the sign from -0


def format_covariance(covariance: Covariance) -> str:
    """Return the standard deviations of a position and of its rotation."""
    place_m, turn = deviations(covariance)
    return f"{place_m:.2f} m, {math.degrees(turn):.1f}°"


def format_evidence(evidence: Evidence) -> str:
    """Return the evidence for and against a pose in one line."""
    return (
        f"{evidence.agreed_wall_m:.1f} m of wall agree ({evidence.agreement:.0%}), "
        f"{evidence.weakest_wall_m:.1f} m of them resist sliding, "
        f"{evidence.conflict:.0%} lie in free space of the other map"
    )


def covariance_of(
    target: WallMap, source: WallMap, T_target_source: SE2, limits: Limits, config: ExactnessConfig
) -> Covariance:
    """Return the covariance of an alignment, from the walls of both maps that agree."""
    metres, points, normals = (
        np.concatenate(both)
        for both in zip(
            _agreeing(source, target, T_target_source, SE2.identity(), limits),
            _agreeing(target, source, T_target_source.inverse(), T_target_source.inverse(), limits),
            strict=True,
        )
    )
    middle = np.average(points, axis=0, weights=metres) if metres.sum() > 0.0 else np.zeros(2)
    x, y = (points - middle).T
    pulls = np.column_stack((normals, x * normals[:, 1] - y * normals[:, 0]))
    information = (pulls * metres[:, None]).T @ pulls / config.wall_m**2
    prior = np.array([config.place_m, config.place_m, config.turn_rad]) ** -2.0
    bend = np.array([config.bend_m, config.bend_m, config.bend_rad]) ** 2
    there = np.linalg.inv(information + np.diag(prior)) + np.diag(bend)
    return seen_from(_rows(there), SE2(float(middle[0]), float(middle[1]), 0.0))


def _agreeing(
    moving: WallMap, fixed: WallMap, T_fixed_moving: SE2, T_source_moving: SE2, limits: Limits
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return half the lengths (N,) of one map's agreeing walls (the other map counts the rest), points and normals."""
    some = moving.some(MANY_WALLS)
    agree = some[classify_walls(moving.walls, some, fixed.walls, T_fixed_moving, limits) == AGREES]
    cell_m = moving.geometry.resolution * len(moving.points) / max(len(some), 1)
    turn = SE2(0.0, 0.0, T_source_moving.theta)
    return (
        0.5 * cell_m * moving.weights[agree],
        T_source_moving.apply(moving.points[agree]),
        turn.apply(moving.normals[agree]),
    )


def seen_from(covariance: Covariance, T_here_there: SE2) -> Covariance:
    """Return the covariance of the same error in another frame (Sola et al., "A micro Lie theory", eq. 55 and 57)."""
    adjoint = T_here_there.matrix()
    adjoint[:2, 2] = T_here_there.y, -T_here_there.x
    return _rows(adjoint @ np.array(covariance) @ adjoint.T)


def bent_by(covariance: Covariance, apart_m: float, apart_rad: float) -> Covariance:
    """Return the covariance of an alignment enlarged by RMS deviations of its parts [m], [rad].

    It is enlarged at the point where it is smallest.
    """
    x, y = known_best_at(covariance)
    there = np.array(seen_from(covariance, SE2(-x, -y, 0.0))) + np.diag(
        [apart_m**2 / 2.0, apart_m**2 / 2.0, apart_rad**2]
    )
    return seen_from(_rows(there), SE2(x, y, 0.0))


def known_best_at(covariance: Covariance) -> tuple[float, float]:
    """Return the point (x, y) of the source whose position is known best [m]: a rotation error does not move it.

    It is the centroid of the agreeing walls and does not depend on the source's frame.
    """
    turn = covariance[2][2]
    return -covariance[1][2] / turn, covariance[0][2] / turn


def deviations(covariance: Covariance) -> tuple[float, float]:
    """Return the standard deviations of the position at the best known point [m] and of the rotation [rad]."""
    all_ = np.array(covariance)
    turn = float(all_[2, 2])
    place = all_[:2, :2] - np.outer(all_[:2, 2], all_[2, :2]) / turn
    return math.sqrt(max(float(np.trace(place)), 0.0)), math.sqrt(turn)


def _rows(matrix: FloatArray) -> Covariance:
    return tuple(tuple(row) for row in matrix.tolist())
