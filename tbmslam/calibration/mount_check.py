"""Checks of the stated mount of the laser: its pose on the robot, and a rotation during the drive.

Odometry and scans determine the mount (see `tbmslam.calibration.hand_eye`). A rotation during the drive is a change
point: the mounts before and after it explain the motions best (D. Hinkley, "Inference about the change-point in a
sequence of random variables", Biometrika 1970). It is accepted only if the scans rotated by as much at that moment
while the odometry did not: slipping wheels do not rotate the scans.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.calibration.hand_eye import FREE, Motions, SensorPlace, estimated, robust_weights
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.kernels import IntArray
from tbmslam.map.keyframes import Keyframes


class MountCheckConfig(FrozenConfig):
    """Thresholds of warnings about the stated mount of the laser."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="check the stated mount and the clocks by odometry and scans")
    parts: int = Field(6, ge=2, description="parts of a drive from which the mount is estimated separately")
    motions: int = Field(4, ge=2, description="least number of motions of half a metre of each part")
    distance: float = Field(
        0.15, gt=0, description="distance that causes a warning [m]; slip of the wheels in turns causes 0.1"
    )
    angle: float = Field(math.radians(5.0), gt=0, description="rotation that causes a warning [rad]")
    sure: float = Field(4.0, gt=0, description="standard deviations that count as certain")
    scale: float = Field(0.2, gt=0, description="largest relative difference of the lengths by odometry and by scans")
    opposed: float = Field(
        0.8, gt=0, le=1, description="least negative correlation of both rotations for a laser upside down"
    )
    turning: float = Field(1.0, gt=0, description="least total rotation for a laser upside down [rad]")
    mirrored: float = Field(
        10.0,
        gt=0,
        description="least log likelihood ratio, of mirrored against equal rotations, for a laser upside down",
    )


def mount_warning(
    keyframes: Keyframes, motions: Motions, place: SensorPlace | None, config: MountCheckConfig
) -> str | None:
    """Return a warning if the motions of odometry and scans contradict the stated mount of the laser, else None.

    `place` is the mount that was estimated from them. The stated mount must hardly move.
    """
    if _is_upside_down(motions.turns[:, 0], motions.turns[:, 1], config):
        return (
            "the scans turn left where the odometry turns right: the laser hangs upside down, and the map is a mirror "
            "image (--upside-down; --no-upside-down where tf says so), or the odometry is wrong (--odometry none)"
        )
    if place is None or not 1.0 / (1.0 + config.scale) <= place.scale <= 1.0 + config.scale:
        return None
    stated, limits = keyframes.sensor_poses[0].tolist(), (config.distance, config.distance, config.angle)
    apart = [place.pose[0] - stated[0], place.pose[1] - stated[1], math.remainder(place.pose[2] - stated[2], math.tau)]
    # Coordinates that are not determined keep the stated value, as the position if the robot hardly turns.
    known = [config.sure * deviation < limit for deviation, limit in zip(place.deviations, limits, strict=True)]
    # A rotation that surely exceeds its limit may be less certain, as that of a laser that looks backwards. Deviations
    # of the position are too small for that where the robot hardly turns (a false warning on a campus).
    known[2] |= config.sure * place.deviations[2] < abs(apart[2]) - config.angle
    if not any(abs(far) > limit and is_known for far, limit, is_known in zip(apart, limits, known, strict=True)):
        return None
    likely = [fit if is_known else value for fit, value, is_known in zip(place.pose, stated, known, strict=True)]
    (x, y, turn), (stated_x, stated_y, stated_turn) = _as_text(likely), _as_text(stated)
    return (
        f"odometry and scans fit best where the laser sits on the robot at {x}, {y} m, {turn} degrees, "
        f"not at {stated_x}, {stated_y} m, {stated_turn} degrees: try --sensor-pose {x} {y} {turn}"
    )


def _is_upside_down(wheels: FloatArray, seen: FloatArray, config: MountCheckConfig) -> bool:
    """Return whether the rotations (M,) [rad] by odometry and by scans are opposite.

    The likelihood of each hypothesis is that of its residuals, normal with an unknown deviation. The ratio grows with
    the number of motions, so unrelated rotations of a long drive may reach it. Therefore they must also correlate.
    """
    if min(float(np.abs(wheels).sum()), float(np.abs(seen).sum())) < config.turning:
        return False
    lengths = math.sqrt(float(wheels @ wheels) * float(seen @ seen))
    errors = (wrap_angles(seen - wheels), wrap_angles(seen + wheels))
    equal, mirrored = (max(float(error @ error), _EXACT) for error in errors)
    evidence = 0.5 * len(wheels) * math.log(equal / mirrored)
    return evidence >= config.mirrored and float(wheels @ seen) <= -config.opposed * lengths


_EXACT = 1e-9
"""Least sum of squared residuals, against a division by zero [rad^2]."""


def _as_text(pose: Sequence[float]) -> tuple[str, str, str]:
    """Return a pose rounded to centimetres and degrees, without negative zeros."""
    x, y, turn = (
        round(value, digits) + 0.0 for value, digits in ((pose[0], 2), (pose[1], 2), (math.degrees(pose[2]), 0))
    )
    return f"{x:.2f}", f"{y:.2f}", f"{turn:.0f}"


_PARTS, _LEAST = 3, 4
"""Number of parts before and after a change from which the rotation is estimated, and least motions of a part."""
_ROUNDS = 3
_MAYBE = 0.5
"""A change is examined if its first estimate exceeds this share of the smallest rotation worth a warning."""
_DEPTH = 2  # levels of recursive division: at most three changes are found
_COARSE_SPLITS = 64  # moments of a part that are tried first
_SURE = 4.0  # standard deviations within which the smallest rotation worth a warning must be known


class MountChange(NamedTuple):
    """A rotation of the laser on its robot during the drive."""

    keyframe: int
    """The first keyframe after it."""
    turn: float
    """The rotation, counterclockwise [rad]."""


def mount_changes(motions: Motions, odometry: FloatArray, sensors: FloatArray, least: float) -> list[MountChange]:
    """Return the rotations of the laser on its robot, larger than `least` [rad], in the order of the drive.

    The poses (K, 3) are those of `tbmslam.calibration.hand_eye.motions_of`, which returns the motions.
    """
    splits, known = _splits(motions, least, _DEPTH), dict[tuple[int, int], tuple[float, float]]()
    while splits:
        edges = [0, *splits, len(motions.sides)]
        for part in pairwise(edges):
            if part not in known:
                known[part] = _turn(_some(motions, slice(*part)))
        turns = [_turned(known[before], known[after]) for before, after in pairwise(pairwise(edges))]
        knocks = [
            _knocked_at(motions.ends[:, split - 1 : split + 1], odometry, sensors, turn, least)
            if abs(turn) > least > sure
            else None
            for split, (turn, sure) in zip(splits, turns, strict=True)
        ]
        doubtful = [number for number, keyframe in enumerate(knocks) if keyframe is None]
        if not doubtful:
            found = zip(knocks, turns, strict=True)
            return [MountChange(int(keyframe), turn) for keyframe, (turn, _) in found if keyframe is not None]
        del splits[min(doubtful, key=lambda number: abs(turns[number][0]))]  # joins its parts to one with more motions
    return []


def _splits(motions: Motions, least: float, depth: int) -> list[int]:
    """Return the motions before which the mount may have rotated by `least` [rad]; divides `depth` times."""
    found = _split(motions) if depth else None
    if found is None:
        return []
    split, turn = found
    before = _splits(_some(motions, slice(0, split)), least, depth - 1)
    after = _splits(_some(motions, slice(split, None)), least, depth - 1)
    return [*before, *([split] if abs(turn) > _MAYBE * least else []), *(split + later for later in after)]


def _some(motions: Motions, part: slice) -> Motions:
    return Motions(motions.ends[:, part], motions.slopes[part], motions.sides[part], motions.turns[part])


def _split(motions: Motions) -> tuple[int, float] | None:
    """Return the motion before which the mount most likely rotated, and the rotation [rad]; None for few motions."""
    slopes, sides = motions.slopes, motions.sides
    count, least = len(sides), _PARTS * _LEAST
    if count < 2 * least:
        return None
    apart = max((count - 2 * least) // _COARSE_SPLITS, 1)
    split, turn, weights = 0, 0.0, np.ones(count)
    for _ in range(_ROUNDS):
        weighted = np.swapaxes(slopes, 1, 2) * weights[:, None, None]
        curvatures = np.cumsum(weighted @ slopes, axis=0)
        pulls = np.cumsum((weighted @ sides[:, :, None])[:, :, 0], axis=0)
        # The likelihood changes slowly from motion to motion: some splits first, then all near the best.
        roughly = _best_split(curvatures, pulls, np.arange(least, count - least + 1, apart))[0]
        nearby = np.arange(max(roughly - apart, least), min(roughly + apart, count - least) + 1)
        split, before, after = _best_split(curvatures, pulls, nearby)
        turn = math.remainder(_angle(after) - _angle(before), math.tau)
        places = np.where((np.arange(count) < split)[:, None], before, after)
        weights = robust_weights(np.hypot(*(sides - (slopes @ places[:, :, None])[:, :, 0]).T))[0]
    return split, turn


def _best_split(curvatures: FloatArray, pulls: FloatArray, splits: IntArray) -> tuple[int, FloatArray, FloatArray]:
    """Return the split (of S) that explains the motions best, and the unknowns (5,) before and after it.

    Curvatures (M, 5, 5) and pulls (M, 5) are cumulative sums over the motions.
    """
    before, after = curvatures[splits - 1], curvatures[-1] - curvatures[splits - 1]
    pulls_before, pulls_after = pulls[splits - 1], pulls[-1] - pulls[splits - 1]
    places_before = np.linalg.solve(before + FREE, pulls_before[:, :, None])[:, :, 0]
    places_after = np.linalg.solve(after + FREE, pulls_after[:, :, None])[:, :, 0]
    gains = np.einsum("sj,sj->s", pulls_before, places_before) + np.einsum("sj,sj->s", pulls_after, places_after)
    best = int(gains.argmax())
    return int(splits[best]), places_before[best], places_after[best]


def _turned(before: tuple[float, float], after: tuple[float, float]) -> tuple[float, float]:
    """Return the rotation between two parts, and the smallest rotation that is significant [rad]."""
    return math.remainder(after[0] - before[0], math.tau), _SURE * math.hypot(before[1], after[1])


def _turn(motions: Motions) -> tuple[float, float]:
    """Return the angle of the laser on the robot and its standard deviation [rad]."""
    whole, deviations = estimated(motions.slopes, motions.sides, _PARTS)
    return _angle(whole), float(max(deviations[2:4])) / max(math.hypot(whole[2], whole[3]), 1e-6)


def _angle(place: FloatArray) -> float:
    """Return the angle of the unknowns (5,) [rad]."""
    return math.atan2(place[3], place[2])


def _knocked_at(ends: IntArray, odometry: FloatArray, sensors: FloatArray, turn: float, least: float) -> int | None:
    """Return the keyframe of two motions at which the scans rotated by `turn` and the odometry did not.

    None if scans and odometry differ nowhere by `turn`, to within `least` [rad].
    """
    first, last = int(ends[0, 0]), int(ends[1, -1])
    seen = np.diff(sensors[first : last + 1, 2])
    wheels = np.diff(odometry[first : last + 1, 2])
    astray = np.abs(wrap_angles(seen - wheels - turn))
    if np.isnan(astray).all():
        return None
    nearest = int(np.nanargmin(astray))
    return first + nearest + 1 if astray[nearest] < least else None
