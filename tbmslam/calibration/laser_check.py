"""Check of the stated laser geometry: the angle step and the range offset are fitted to the walls of the drive.

The stated angles between beams may be too small by a constant share. If a scan takes time while the robot turns in the
beams' direction, they are also too small in proportion to the turn rate. Ranges may have an offset. These errors rotate
and shift each sighting of a wall about the laser, so their equations follow from those of the poses.
"""

import logging
from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.calibration.hand_eye import deviations_of_parts
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray, IntArray, path_lengths, wrap_angles
from tbmslam.geometry.trajectory import turn_rates
from tbmslam.kernels.adjustment.line_adjustment import line_equations
from tbmslam.kernels.adjustment.pose_systems import MotionSystem, PoseSystem, times
from tbmslam.kernels.adjustment.wall_pieces import StretchHits, gather_hits
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, WallLines, held_poses, stretch_begins
from tbmslam.optimisation.pose_graph import PoseSolver, coarse_space_of

logger = logging.getLogger(__name__)


_NUMBERS = 3
_SCALE, _OFFSET, _SWEEP = range(_NUMBERS)
"""Relative error of the angles between beams, offset of the ranges [m], time of a beam's rotation by a radian [s]."""
_PRIOR = np.array([0.1, 0.3, 0.1]) ** -2.0  # prior information of the same, from their standard deviations
_NO_MOTIONS = MotionSystem(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3, 3)))


class LaserFitConfig(FrozenConfig):
    """Fit of the angle step and the range offset to the walls."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="fit them after the adjustment")
    most_parts: int = Field(6, ge=2, description="largest number of parts of a drive that are fitted separately")
    least_parts: int = Field(4, ge=2, description="smallest number of parts; shorter drives are not checked")
    shortest: float = Field(5.0, gt=0, description="least travelled length of a part [m]")
    longest: float = Field(40.0, gt=0, description="largest travelled length of a part that is used [m]")
    least_fan: float = Field(
        1.75, gt=0, description="least field of view [rad]; with a narrower one the fit contracts all hits to a point"
    )
    max_range: float = Field(12.0, gt=0, description="hits beyond this are not used [m]")
    hits: int = Field(120, ge=10, description="least number of hits of a scan that are used, if it has as many")
    deviation: float = Field(0.03, gt=0, description="standard deviation of a hit from its wall [m]")
    notable_scale: float = Field(
        0.002, gt=0, description="relative error of the angle step from which more rounds are made"
    )
    notable_offset: float = Field(0.02, gt=0, description="range offset from which more rounds are made [m]")
    rounds: int = Field(12, ge=1, description="largest number of rounds")


class PartFit:
    """Fit of the laser's errors and of the poses to one part of a drive, round by round.

    `hits` are those of the part's N scans, taken at `poses` (N, 3) of the laser. `middles` (N,) are the angles of the
    middle beams [rad], and `rates` (N,) the turn rates, positive in the direction of the beams [rad/s].
    """

    def __init__(
        self,
        hits: ScanHits,
        poses: FloatArray,
        middles: FloatArray,
        rates: FloatArray,
        config: LaserFitConfig,
        pieces: AdjustmentConfig,
    ) -> None:
        self._pieces = pieces.model_copy(update={"deviation": config.deviation})
        self._poses, self._middles, self._rates = poses, middles, rates
        count, limits = len(poses), (config.max_range, pieces.gap, pieces.bulge)
        every = max(len(hits.points) // (config.hits * count), 1)
        own, sines = gather_hits(hits.points, hits.normals, hits.offsets, np.zeros((count, 3)), every, limits)
        self._begins, self._scans = own.wall_begins, np.repeat(np.arange(count), np.diff(own.wall_begins))
        x, y, cosines = own.walls.T
        self._ranges, self._directions, self._normals = np.hypot(x, y), np.arctan2(y, x), np.arctan2(sines, cosines)
        self._angles = wrap_angles(self._directions - middles[self._scans])
        self._coarse = coarse_space_of([0, count])
        self._held = held_poses(count)
        self._numbers = np.zeros(_NUMBERS)
        self._round = 0

    def improved(self) -> tuple[FloatArray, FloatArray]:
        """Do one round; return the errors (M,) and their information (M, M)."""
        at, pieces = self._poses, self._pieces
        walls = WallLines(self._corrected_hits(), 1, at, self._round, pieces)
        solver = PoseSolver(
            PoseSystem(walls.own + self._held, walls.system, _NO_MOTIONS), at, self._coarse, pieces.precision
        )
        # The same equations with a pose of its own for each sighting, which moves with the errors of the laser.
        movements, observers = self._movements(walls), walls.observers
        own, system, pull = line_equations(
            *(walls.moments, np.arange(len(observers)), walls.begins, walls.lines, at[observers]),
            *(pieces.enough, pieces.deviation, pieces.robust_width),
        )
        each = PoseSystem(own, system, _NO_MOTIONS)
        curved = np.array([times(each, movement) for movement in movements])
        across = np.array([_summed(change, observers, len(at)) for change in curved])
        # Elimination of the poses.
        following = np.array([solver.solve(pushed) for pushed in across])
        information = np.einsum("iok,jok->ij", movements, curved) - np.einsum("ink,jnk->ij", following, across)
        information = 0.5 * (information + information.T) + np.diag(_PRIOR)
        slope = np.tensordot(movements, pull) - np.tensordot(following, walls.gradient) + _PRIOR * self._numbers
        change = -np.linalg.solve(information, slope)
        self._poses = at - solver.solve(walls.gradient) - np.tensordot(change, following, 1)
        self._poses[:, 2] = wrap_angles(self._poses[:, 2])
        self._numbers = self._numbers + change
        self._round += 1
        return self._numbers, information

    def _corrected_hits(self) -> StretchHits:
        """Return the hits without the errors estimated so far."""
        scales = self._numbers[_SCALE] + self._numbers[_SWEEP] * self._rates
        turns = (scales[self._scans] * self._angles).astype(np.float32)
        ranges, directions = self._ranges + np.float32(self._numbers[_OFFSET]), self._directions + turns
        columns = ranges * np.cos(directions), ranges * np.sin(directions), wrap_angles(self._normals + turns)
        loose = np.empty((0, 2), dtype=np.float32)
        return StretchHits(
            np.column_stack(columns).astype(np.float32), self._begins, loose, np.zeros_like(self._begins)
        )

    def _movements(self, walls: WallLines) -> FloatArray:
        """Return the movement (M, O, 3) of each sighting about the laser by each error."""
        x, y = walls.moments[:, 1:3].T
        scans = walls.observers
        angles = wrap_angles(np.arctan2(y, x) - self._poses[scans, 2] - self._middles[scans])
        movements = np.zeros((_NUMBERS, len(scans), 3))
        movements[_SCALE, :, 2], movements[_SWEEP, :, 2] = angles, self._rates[scans] * angles
        movements[_OFFSET, :, :2] = np.column_stack((x, y)) / np.hypot(x, y)[:, None]
        return movements


class LaserErrors(NamedTuple):
    """Estimated errors of the stated laser geometry."""

    scale: float
    """Relative error of the angle step: the true step is larger by this share."""
    scale_deviation: float
    offset: float
    """The correction to add to every range [m]."""
    offset_deviation: float
    """Standard deviation of `offset` [m]."""


_SETTLED = np.array([5e-4, 2e-3])  # the rounds end if they change the scale [1] and the offset [m] by less,
_OF_DEVIATION = 0.3  # or by less than this share of their standard deviations,
_CHANCE = 2.0  # or if both are within this number of standard deviations from zero
_FARTHEST = np.array([0.1, 0.5])
"""Largest plausible scale [1] and offset [m]. Beyond them the fit diverges: all hits contract to one point."""


def fit_laser(
    keyframes: Keyframes, hits: ScanHits, poses: FloatArray, config: LaserFitConfig, pieces: AdjustmentConfig
) -> LaserErrors | None:
    """Estimate the errors of the stated laser geometry.

    None if the drive or the field of view is too small, or if the estimate does not converge.

    `poses` (K, 3) are the adjusted poses of the laser at the keyframes. `config` and `pieces` are the parameters of the
    fit and of wall pieces.
    """
    first, step, beams = keyframes.beams[:, 0], keyframes.beams[:, 1], np.diff(keyframes.offsets)
    if not len(beams) or float(np.median(beams * np.abs(step))) < config.least_fan:
        return None
    chosen = [scans for scans in _parts(poses, config, pieces) if len(scans) > 1]
    if len(chosen) < config.least_parts:
        return None
    rates, middles = turn_rates(keyframes.stamps, poses[:, 2]) * np.sign(step), first + 0.5 * (beams - 1) * step
    parts = [
        PartFit(_hits_of(hits, scans), poses[scans], middles[scans], rates[scans], config, pieces) for scans in chosen
    ]
    found = _settled(parts, config)
    if found is None:
        return None
    scale, offset, scale_deviation, offset_deviation = found.tolist()
    logger.info(
        "angles between beams fit %+.2f%% (%.2f%%) larger, ranges %+.3f m (%.3f m) longer",
        *(100.0 * scale, 100.0 * scale_deviation, offset, offset_deviation),
    )
    return LaserErrors(scale, scale_deviation, offset, offset_deviation)


def _summed(values: FloatArray, owners: IntArray, count: int) -> FloatArray:
    """Return the sums (count, 3) of the values (O, 3) of each owner (O,)."""
    return np.column_stack([np.bincount(owners, column, count) for column in values.T])


def _hits_of(hits: ScanHits, scans: IntArray) -> ScanHits:
    # By slices, in a tenth of the time of an index for each hit.
    own = [slice(*hits.offsets[k : k + 2]) for k in scans]
    points, normals = (np.concatenate([rows[part] for part in own]) for rows in (hits.points, hits.normals))
    return ScanHits(points, normals, np.concatenate(([0], np.cumsum(np.diff(hits.offsets)[scans]))))


def _settled(parts: Sequence[PartFit], config: LaserFitConfig) -> FloatArray | None:
    """Improve the parts until their joint estimate (see `_joined`) converges or is negligible, else return None."""
    before, notable = np.full(2, np.inf), np.array([config.notable_scale, config.notable_offset])
    for _ in range(config.rounds):
        found = _joined([part.improved() for part in parts])
        numbers, deviations = found[:2], found[2:]
        if (np.abs(numbers) > _FARTHEST).any():
            return None
        is_nothing = (np.abs(numbers) < np.maximum(notable, _CHANCE * deviations)).all()
        if is_nothing or (np.abs(numbers - before) < np.maximum(_SETTLED, _OF_DEVIATION * deviations)).all():
            return found
        before = numbers
    return None


def _parts(poses: FloatArray, config: LaserFitConfig, pieces: AdjustmentConfig) -> list[IntArray]:
    """Return the scans of each part: one scan of each short segment, since scans within a segment are alike."""
    travelled = path_lengths(poses)
    count = min(int(travelled[-1] / config.shortest), config.most_parts)
    if count < config.least_parts:
        return []
    scans = stretch_begins(poses, pieces)
    begins = np.linspace(0.0, travelled[-1], count + 1)[:-1]
    ends = begins + min(travelled[-1] / count, config.longest)
    return [
        scans[(travelled[scans] >= begin) & (travelled[scans] < end)] for begin, end in zip(begins, ends, strict=True)
    ]


def _joined(estimates: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the joint scale and offset of the parts and their standard deviations (4,)."""
    values, informations = (np.array(column) for column in zip(*estimates, strict=True))
    mean = np.linalg.solve(informations.sum(axis=0), np.einsum("pij,pj->i", informations, values))
    return np.concatenate((mean[:2], deviations_of_parts(values, informations, mean)[:2]))


_USUAL_STEPS_DEG = (2.0, 1.0, 0.5, 0.36, 360.0 / 1024.0, 1.0 / 3.0, 0.25, 0.225, 0.2, 0.125, 0.1)
_NEARLY = 0.002  # largest relative error of the fitted step for correctly described lasers
_HALFWAY = 0.5 * min(larger / smaller - 1.0 for larger, smaller in pairwise(_USUAL_STEPS_DEG))
"""Half the least relative difference of two usual steps, 1.2 %."""


class LaserCheckConfig(FrozenConfig):
    """Thresholds of warnings about the stated laser geometry."""

    scale: float = Field(0.0035, gt=0, description="relative error of an unusual angle step that causes a warning")
    offset: float = Field(
        0.06, gt=0, description="range offset that causes a warning [m]; the fit of a correct laser had 0.05"
    )
    sure: float = Field(4.0, gt=0, description="standard deviations that an error must exceed to cause a warning")


def laser_warnings(
    errors: LaserErrors, keyframes: Keyframes, config: LaserCheckConfig, range_offset: float = 0.0
) -> dict[str, str]:
    """Return the warnings about angles and ranges that the walls contradict, from the errors of the scans as read.

    `range_offset` is the correction that was added to every range when it was read [m].
    """
    warnings = {}
    if abs(errors.scale) > max(config.scale, config.sure * errors.scale_deviation):
        warnings["angles"] = _angle_warning(errors, keyframes, config)
    if abs(errors.offset) > max(config.offset, config.sure * errors.offset_deviation):
        warnings["ranges"] = _range_warning(errors.offset + range_offset, range_offset)
    return {about: warning for about, warning in warnings.items() if warning}


def _range_warning(offset: float, added: float) -> str:
    """Return the warning about a range offset; `added` was added when the ranges were read [m]."""
    instead = "" if added == 0.0 else f", not {_longer(added)}"
    remedy = f"try --range-offset {offset:.2f}" if round(offset, 2) else "try without --range-offset"
    return f"walls fit best where ranges are {_longer(offset)}{instead}: {remedy}"


def _longer(offset: float) -> str:
    """Return an offset of the ranges [m] as text."""
    if not round(offset, 2):
        return "as measured"
    return f"{abs(offset):.2f} m {'longer' if offset > 0.0 else 'shorter'} than measured"


def _angle_warning(errors: LaserErrors, keyframes: Keyframes, config: LaserCheckConfig) -> str:
    """Return the warning about the angle step; empty if the stated step is plausible.

    A stated step is plausible if its error is at most half the least difference of two usual steps, and it is a usual
    step of real lasers or the beams cover a full turn. Such an error is one of the fit: of a pitched laser, or of a
    part of a building with few walls.
    """
    steps, counts = np.degrees(np.abs(keyframes.beams[:, 1])), np.diff(keyframes.offsets)
    if np.ptp(counts) or np.ptp(steps) > 1e-6 * steps[0]:  # the scans have different angle steps
        apart = f"{abs(errors.scale):.1%} {'larger' if errors.scale > 0.0 else 'smaller'}"
        return f"walls fit best where angles between beams are {apart}: check the driver of the laser"
    stated, beams = float(steps[0]), int(counts[0])
    goes_once_round = abs(stated * beams - 360.0) <= _NEARLY * 360.0
    if abs(errors.scale) <= _HALFWAY and (goes_once_round or _nearest_usual(stated, _NEARLY)):
        return ""
    fit = stated * (1.0 + errors.scale)
    closes = abs(stated * beams - 360.0) <= 1.5 * stated
    likely = _likely_step(fit, stated, beams, max(_NEARLY, config.sure * errors.scale_deviation), closes=closes)
    if likely is None and closes:  # the last beam meets the first, so no other step is possible
        return ""
    corrected = f"{fit:.4g}" if likely is None else f"{likely:.6g}"
    negative = f", or -{corrected} where it is stated negative" if keyframes.beams[0, 1] < 0.0 else ""
    return (
        f"walls fit best where beams are {fit:.4g} degrees apart, not {stated:.5g}: "
        f"try --angle-step-deg {corrected}{negative}"
    )


def _likely_step(fit: float, stated: float, beams: int, nearly: float, *, closes: bool) -> float | None:
    """Return the likely true step near the fitted one [degrees]; None if no likely step is that near."""
    full_turn = [360.0 / beams, 360.0 / (beams - 1)]
    if not closes:
        usual = _nearest_usual(fit, max(_HALFWAY, nearly))
        if usual and abs(usual - fit) < abs(stated - fit):
            return usual
    others = full_turn if closes else [stated * (beams - 1) / beams, *full_turn]
    near = min(others, key=lambda step: abs(step - fit))
    return near if abs(near - fit) <= nearly * fit else None


def _nearest_usual(step: float, nearly: float) -> float | None:
    """Return the usual step of real lasers within a relative distance of a step [degrees]."""
    nearest = min(_USUAL_STEPS_DEG, key=lambda usual: abs(usual - step))
    return nearest if abs(nearest - step) <= nearly * step else None
