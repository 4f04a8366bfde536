"""The pose of one map in the frame of another, or the reason why it is unknown."""

import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property

from merging.verification.covariance import Covariance, deviations, seen_from
from merging.verification.evidence import Evidence
from tbmslam.geometry.se2 import SE2, wrap_angle

Pair = tuple[str, str]
"""The names of a target and a source map."""


_SURE = 0.999
"""No hypothesis is believed more than this, and none less than the rest to 1."""


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
    """The answer to "where does the source map lie in the target's frame?".

    A refused pair has an answer too: `accepted` is False, `reason` says why, and the transform, if there is one, is the
    pose that was refused. It is never the identity by default.

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
        Covariance of the transform if it is right; see `merging.verification.covariance`. None if the method does not
        estimate it.
    bent_m
        RMS deformation of one of the maps [m]; 0 for a rigid alignment.
    lead
        For `correlation`, the score of the best pose divided by that of the next pose, on coarse cells; 0 if there is
        none.
    T_more_less
        For `correlation`, that best pose: of the map with less wall in the frame of the other map.
    ambiguous
        Whether it was refused because the maps fit well at several poses.
    alternatives
        Other likely poses, the most likely first.
    evidence
        The evidence for and against it; None if there is no transform.
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
    T_more_less: SE2 | None = None
    ambiguous: bool = False
    alternatives: tuple[PoseHypothesis, ...] = ()
    evidence: Evidence | None = None

    def __repr__(self) -> str:
        """Return one line: the pose of the source in the target's frame, and the reason."""
        verdict = "accepted" if self.accepted else "refused"
        if self.T_target_source is None:
            return f"Alignment({verdict}: {self.reason})"
        x, y, degrees = format_pose(self.T_target_source)
        return f"Alignment({verdict}, x {x} m, y {y} m, turned {degrees} degrees: {self.reason})"

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
            self, T_target_source=self.T_target_source.inverse(), covariance=covariance, alternatives=alternatives
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
        values = asdict(self)
        del values["T_more_less"]
        values["T_target_source"] = None if self.T_target_source is None else list(self.T_target_source)
        # The scale is not a number if all inliers lie at one point.
        values["scale"] = self.scale if self.scale is not None and math.isfinite(self.scale) else None
        for alternative in values["alternatives"]:
            alternative["T_target_source"] = list(alternative["T_target_source"])
            del alternative["accepted"]  # no alternative is
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
        f"{evidence.weakest_wall_m:.1f} m of them against sliding, "
        f"{evidence.conflict:.0%} stand on free space of the other"
    )
