"""Numbers as people read them."""

import math

from merging.verification.covariance import Covariance, deviations
from merging.verification.evidence import Evidence
from tbmslam.geometry.se2 import SE2, wrap_angle


def format_confidence(confidence: float) -> str:
    """Return a probability with three decimals, never rounded up to certainty."""
    return "> 0.999" if confidence >= 0.9995 else f"{confidence:.3f}"


def format_pose(pose: SE2 | None) -> tuple[str, str, str]:
    """Return x [m], y [m] and theta [deg]; dashes where there is no pose."""
    if pose is None:
        return "–", "–", "–"
    return f"{pose.x:.3f}", f"{pose.y:.3f}", f"{math.degrees(wrap_angle(pose.theta)):.2f}"


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
