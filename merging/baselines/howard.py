"""Howard's method: two robots measure their relative pose when they meet, which gives the transform of their maps.

A. Howard, "Multi-robot simultaneous localization and mapping using particle filters", IJRR 2006. An encounter gives the
relative pose of two robots. From there, each robot's readings are added to the common map, forward and backward in
time. The rule `average` fuses cells.

Choices of this project: Finished maps are merged instead of readings, so no filter corrects the error of the
measurement. Several encounters are averaged. Encounters are assumed to be correct. Only the benchmark has encounters,
since it simulates them.
"""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment
from tbmslam.geometry.se2 import SE2

METRES, DEGREES = 0.05, 1.0
"""Standard deviations of a simulated measurement of a pose, along each axis and of its direction."""


class Encounter(NamedTuple):
    """The measurement of two robots that see each other."""

    T_target_robot: SE2
    """Pose of the target's robot in its map."""
    T_robot_other: SE2
    """Measured pose of the source's robot in the frame of the target's robot."""
    T_source_other: SE2
    """Pose of the source's robot in its map."""


def align(encounters: Sequence[Encounter]) -> Alignment:
    """Estimate the pose of a source in the target's frame from the encounters of the robots."""
    if not encounters:
        return Alignment("howard", accepted=False, reason="the robots never met")
    met = [encounter.T_target_robot @ encounter.T_robot_other for encounter in encounters]
    motions = [there @ encounter.T_source_other.inverse() for there, encounter in zip(met, encounters, strict=True)]
    theta = cmath.phase(sum(cmath.exp(1j * motion.theta) for motion in motions))
    rotation = SE2(0.0, 0.0, theta)
    # The source is rotated about the place of the encounter.
    places = rotation.apply([(encounter.T_source_other.x, encounter.T_source_other.y) for encounter in encounters])
    x, y = np.mean([(there.x, there.y) for there in met] - places, axis=0)
    reason = f"the robots met {len(encounters)} time{'s' if len(encounters) > 1 else ''}"
    return Alignment("howard", accepted=True, reason=reason, T_target_source=SE2(float(x), float(y), theta))


def measured(T_target_robot: SE2, T_source_other: SE2, T_target_source: SE2, rng: np.random.Generator) -> Encounter:
    """Simulate an encounter: the true relative pose with a normal error of `METRES` and `DEGREES`."""
    true = T_target_robot.inverse() @ T_target_source @ T_source_other
    x, y, theta = rng.normal(0.0, (METRES, METRES, math.radians(DEGREES)))
    return Encounter(T_target_robot, SE2(true.x + x, true.y + y, true.theta + theta), T_source_other)
