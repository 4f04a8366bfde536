"""Whether the angle between beams that a recording states can be true."""

import math

_ROUND_STEPS_DEG = (0.25, 0.5, 1.0)
_MORE_THAN_A_TURN_DEG = 360.5
"""From the first beam to the last; the last one of some lasers is the first one again."""
_LEAST_FAN = 30.0
"""Nearly five turns, or the least that a laser sees in degrees."""


def are_degrees(beams: int, angle_increment: float) -> bool:
    """Return whether angles that should be in radians are in degrees: as radians they would go round many times.

    Parameters
    ----------
    beams
        Number of beams.
    angle_increment
        Stated step.
    """
    return _LEAST_FAN <= abs(angle_increment) * (beams - 1) <= _MORE_THAN_A_TURN_DEG


def angle_warning(beams: int, angle_increment: float) -> str | None:
    """Return a warning if an angle step looks wrong, else None.

    Converters of old logs wrote 180 beams "from -90 to 90 degrees", so that they state 180/179 degrees a step where
    the laser made exactly 1. Simulated lasers do step so, hence this is said and not corrected.

    Parameters
    ----------
    beams
        Number of beams.
    angle_increment
        Stated step [rad].
    """
    if beams < 2:
        return None
    if are_degrees(beams, angle_increment):
        turns = abs(angle_increment) * (beams - 1) / math.tau
        return (
            f"{beams} beams {abs(angle_increment):g} rad apart are stated, {turns:.0f} turns: they are read as degrees"
        )
    step = abs(math.degrees(angle_increment))
    fan = step * (beams - 1)
    if fan > _MORE_THAN_A_TURN_DEG:
        return (
            f"{beams} beams {step:.4f} degrees apart are stated, more than a turn: if they span one turn, pass "
            f"--angle-step-deg {360.0 / beams:.6g}"
        )
    for true_step in _ROUND_STEPS_DEG:
        if abs(fan - true_step * beams) < 0.02 * true_step:
            return (
                f"{beams} beams {step:.4f} degrees apart are stated; real lasers have steps of {true_step:g} "
                f"degrees: for a real laser pass --angle-step-deg {true_step:g}"
            )
    return None
