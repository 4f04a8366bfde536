"""Whether a laser is described wrong, and what would mend it."""

from itertools import pairwise

import numpy as np
from pydantic import Field

from tbmslam.calibration.laser_fit import LaserErrors
from tbmslam.frozen_config import FrozenConfig
from tbmslam.map.keyframes import Keyframes

_USUAL_STEPS_DEG = (2.0, 1.0, 0.5, 0.36, 360.0 / 1024.0, 1.0 / 3.0, 0.25, 0.225, 0.2, 0.125, 0.1)
_NEARLY = 0.002
"""Share by which walls miss the step of lasers that are described right, at the most: a usual step so near is meant."""
_HALFWAY = 0.5 * min(larger / smaller - 1.0 for larger, smaller in pairwise(_USUAL_STEPS_DEG))
"""Half the least share between two usual steps, 1.2 %: up to there, walls that miss one speak for no other."""


class LaserCheckConfig(FrozenConfig):
    """When walls contradict what a laser is described by."""

    scale: float = Field(
        0.0035,
        gt=0,
        description="share by which angles between beams are wrong that is worth a warning, where no laser has them",
    )
    offset: float = Field(0.06, gt=0, description="offset of ranges that is [m]; a real laser without looked like 0.05")
    sure: float = Field(4.0, gt=0, description="standard deviations that either must be, too")


def laser_doubts(
    errors: LaserErrors, keyframes: Keyframes, config: LaserCheckConfig, range_offset: float = 0.0
) -> dict[str, str]:
    """Return a sentence for each number of a laser's description that walls contradict.

    Parameters
    ----------
    errors
        What is wrong with scans as they were read.
    keyframes
        The scans.
    config
        What is worth a warning.
    range_offset
        What was added to every range when it was read [m].
    """
    said = {}
    if abs(errors.scale) > max(config.scale, config.sure * errors.scale_deviation):
        said["angles"] = _angles_said(errors, keyframes, config)
    if abs(errors.offset) > max(config.offset, config.sure * errors.offset_deviation):
        said["ranges"] = _ranges_said(errors.offset + range_offset, range_offset)
    return {about: what for about, what in said.items() if what}


def _ranges_said(offset: float, added: float) -> str:
    """Return what to say of ranges to which so much is to be added, and was when they were read [m]."""
    instead = "" if added == 0.0 else f", not {_longer(added)}"
    remedy = f"try --range-offset {offset:.2f}" if round(offset, 2) else "try without --range-offset"
    return f"walls fit best where ranges are {_longer(offset)}{instead}: {remedy}"


def _longer(offset: float) -> str:
    """Return by how much ranges are longer than measured, in words."""
    if not round(offset, 2):
        return "as measured"
    return f"{abs(offset):.2f} m {'longer' if offset > 0.0 else 'shorter'} than measured"


def _angles_said(errors: LaserErrors, keyframes: Keyframes, config: LaserCheckConfig) -> str:
    """Return what to say of the angles between beams; nothing where they go once round, or are a real laser's, as is.

    Real lasers have few steps, so that one that is stated is hardly wrong by less than leads halfway to another. What
    walls miss it by then is theirs: of a pitched laser, or of a part of a building that tells little.
    """
    steps, counts = np.degrees(np.abs(keyframes.beams[:, 1])), np.diff(keyframes.offsets)
    if np.ptp(counts) or np.ptp(steps) > 1e-6 * steps[0]:  # no one angle can be told
        apart = f"{abs(errors.scale):.1%} {'larger' if errors.scale > 0.0 else 'smaller'}"
        return f"walls fit best where angles between beams are {apart}: look how the laser's driver makes them"
    stated, beams = float(steps[0]), int(counts[0])
    goes_once_round = abs(stated * beams - 360.0) <= _NEARLY * 360.0
    if abs(errors.scale) <= _HALFWAY and (goes_once_round or _nearest_usual(stated, _NEARLY)):
        return ""
    fit = stated * (1.0 + errors.scale)
    closes = abs(stated * beams - 360.0) <= 1.5 * stated
    meant = _meant(fit, stated, beams, max(_NEARLY, config.sure * errors.scale_deviation), closes=closes)
    if meant is None and closes:  # whose beams come round to the first, so that no other angle can be true
        return ""
    mended = f"{fit:.4g}" if meant is None else f"{meant:.6g}"
    turned = f", or -{mended} where it is stated negative" if keyframes.beams[0, 1] < 0.0 else ""
    return (
        f"walls fit best where beams are {fit:.4g} degrees apart, not {stated:.5g}: "
        f"try --angle-step-deg {mended}{turned}"
    )


def _meant(fit: float, stated: float, beams: int, nearly: float, *, closes: bool) -> float | None:
    """Return the step that a laser has whose walls fit one best [degrees]; None where none is so near."""
    once_round = [360.0 / beams, 360.0 / (beams - 1)]
    if not closes:
        usual = _nearest_usual(fit, max(_HALFWAY, nearly))
        if usual and abs(usual - fit) < abs(stated - fit):
            return usual
    others = once_round if closes else [stated * (beams - 1) / beams, *once_round]
    near = min(others, key=lambda step: abs(step - fit))
    return near if abs(near - fit) <= nearly * fit else None


def _nearest_usual(step: float, nearly: float) -> float | None:
    """Return the step of real lasers that is so near to one, as a share of it [degrees]."""
    nearest = min(_USUAL_STEPS_DEG, key=lambda usual: abs(usual - step))
    return nearest if abs(nearest - step) <= nearly * step else None
