"""Angle steps that converters of old logs stretched.

They wrote 180 beams "from -90 to 90 degrees", so they state steps of 180/179 degrees for lasers with steps of exactly 1
degree. Simulated lasers do have such steps.
"""

import math
from dataclasses import replace

from tbmslam.sensing.laser_scan import LaserScan

_ROUND_STEPS_DEG = (0.25, 0.5, 1.0)
_NEARLY = 0.02  # share of a step by which the stated field of view may differ


def round_step_deg(beams: int, angle_increment: float) -> float | None:
    """Return the step before a stated step [rad] was stretched [degrees]; None if it was not stretched."""
    if beams < 2:
        return None
    fan = math.degrees(abs(angle_increment)) * (beams - 1)
    return next((step for step in _ROUND_STEPS_DEG if abs(fan - step * beams) < _NEARLY * step), None)


def unstretched(scan: LaserScan) -> LaserScan:
    """Return a scan with the step before it was stretched; the first beam keeps its direction."""
    step = round_step_deg(len(scan.ranges), scan.angle_increment)
    if step is None:
        return scan
    return replace(scan, angle_increment=math.copysign(math.radians(step), scan.angle_increment))
