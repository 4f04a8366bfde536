"""How one map lies in another's frame, or why nobody knows."""

import math
from dataclasses import asdict, dataclass, replace

from merging.verification.covariance import Covariance, deviations, seen_from
from merging.verification.evidence import Evidence
from tbmslam.geometry.se2 import SE2, wrap_angle

Pair = tuple[str, str]
"""The names of a target and a source map."""


@dataclass(frozen=True)
class Alternative:
    """Another place where the source might lie.

    Parameters
    ----------
    T_target_source
        Pose of the source's frame in the target's frame.
    confidence
        Probability that this is the truth.
    agreed_wall_m
        Length of the walls that agree there [m].
    covariance
        How exactly they tell the place; None where nobody asked.
    """

    T_target_source: SE2
    confidence: float
    agreed_wall_m: float
    covariance: Covariance | None = None

    def reversed(self) -> "Alternative":
        """Return where the target might lie in the source's frame."""
        covariance = _reversed(self.covariance, self.T_target_source)
        return replace(self, T_target_source=self.T_target_source.inverse(), covariance=covariance)


@dataclass(frozen=True, repr=False)
class Alignment:
    """The answer to "where does the source map lie in the target's frame?".

    A refusal is an answer too: `accepted` is False, `reason` says why, and the transform, if there is one, is what was
    refused. It is never the identity by default.

    Parameters
    ----------
    method
        What found it.
    accepted
        Whether it may be used.
    reason
        Why, or why not, in one sentence with the numbers.
    T_target_source
        Pose of the source's frame in the target's frame.
    matches, inliers
        Of `features`, keypoints that look alike, and how many of them the transform brings together; of `correlation`,
        cells of wall in the overlap, and how many of them agree.
    rmse_m
        Root mean square distance of the inliers [m].
    scale
        The factor that would fit the inliers best, where the method estimates it; two maps in metres have 1.
    overlap_m2
        Area both maps know [m^2].
    agreement, conflict
        Shares of the walls in the overlap that agree, and that stand on the other map's free space.
    agreed_wall_m, weakest_wall_m
        Length of the agreeing walls, and what of it resists the easiest slide [m].
    confidence
        Probability that the transform is right: of alignments given 0.9, nine in ten are.
    covariance
        How exact it is if it is right; see `merging.verification.covariance`. None where the method does not tell.
    bent_m
        How far one of the maps was bent to fit, root mean square [m]; 0 where they were laid as they are.
    lead
        Of `correlation`, the score of the best place over that of the next one, on coarse cells; 0 where there is none.
    ambiguous
        Whether it was refused because the maps fit well in several places.
    alternatives
        Other places worth naming, the likeliest first.
    evidence
        All that the maps say for and against it; None where there is no transform.
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
    ambiguous: bool = False
    alternatives: tuple[Alternative, ...] = ()
    evidence: Evidence | None = None

    def __repr__(self) -> str:
        """Return the answer in a line: the pose of the source in the target's frame, and why it is believed or not."""
        verdict = "accepted" if self.accepted else "refused"
        if self.T_target_source is None:
            return f"Alignment({verdict}: {self.reason})"
        x, y, degrees = format_pose(self.T_target_source)
        return f"Alignment({verdict}, x {x} m, y {y} m, turned {degrees} degrees: {self.reason})"

    def at(self, T_target_source: SE2, evidence: Evidence, confidence: float, covariance: Covariance) -> "Alignment":
        """Return the answer with a place, what the maps say for and against it, its probability and exactness."""
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
        """Return where the target lies in the source's frame."""
        if self.T_target_source is None:
            return self
        covariance = _reversed(self.covariance, self.T_target_source)
        others = tuple(one.reversed() for one in self.alternatives)
        return replace(self, T_target_source=self.T_target_source.inverse(), covariance=covariance, alternatives=others)

    def matched_by_walls(self, evidence: Evidence, resolution: float) -> "Alignment":
        """Return the answer of a method whose matches are the walls themselves, in cells of a size [m]."""
        return replace(
            self,
            matches=round(evidence.compared_wall_m / resolution),
            inliers=round(evidence.agreed_wall_m / resolution),
            rmse_m=evidence.rmse_m,
        )

    def as_json(self) -> dict[str, object]:
        """Return the fields as JSON can hold them; the transform as [x m, y m, theta rad] or None."""
        values = asdict(self)
        values["T_target_source"] = None if self.T_target_source is None else list(self.T_target_source)
        # The scale of inliers that all lie on one spot is not a number.
        values["scale"] = self.scale if self.scale is not None and math.isfinite(self.scale) else None
        for alternative in values["alternatives"]:
            alternative["T_target_source"] = list(alternative["T_target_source"])
        return values


def _reversed(covariance: Covariance | None, T_target_source: SE2) -> Covariance | None:
    return None if covariance is None else seen_from(covariance, T_target_source)


def format_confidence(confidence: float) -> str:
    """Return a probability with three decimals, never rounded up to certainty."""
    return "> 0.999" if confidence >= 0.9995 else f"{confidence:.3f}"


def format_pose(pose: SE2 | None) -> tuple[str, str, str]:
    """Return x [m], y [m] and theta [deg]; dashes where there is no pose."""
    if pose is None:
        return "–", "–", "–"
    x, y, degrees = round(pose.x, 3), round(pose.y, 3), round(math.degrees(wrap_angle(pose.theta)), 2)
    return f"{x + 0.0:.3f}", f"{y + 0.0:.3f}", f"{degrees + 0.0:.2f}"  # adding zero takes the sign from -0


def format_covariance(covariance: Covariance) -> str:
    """Return the standard deviations of a place and of its turn."""
    place_m, turn = deviations(covariance)
    return f"{place_m:.2f} m, {math.degrees(turn):.1f}°"


def format_evidence(evidence: Evidence) -> str:
    """Return in a line what two maps say for and against a place."""
    return (
        f"{evidence.agreed_wall_m:.1f} m of wall agree ({evidence.agreement:.0%}), "
        f"{evidence.weakest_wall_m:.1f} m of them against sliding, "
        f"{evidence.conflict:.0%} stand on free space of the other"
    )
