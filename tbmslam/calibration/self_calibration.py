"""Self-calibration of the laser from one part of a drive: its parameters, the poses and the walls are unknown."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.kernels.adjustment.laser_slopes import (
    NUMBERS,
    OFFSET,
    SCALE,
    SWEEP,
    bent_hits,
    laser_equations,
    single_scan_hits,
)
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.map.keyframes import Keyframes
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, WallLines
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge
from tbmslam.optimisation.pose_solver import PoseSolver, bends_of, motions_of

_GAUGE = 1e8
"""Information that fixes the first pose [1/m^2]."""
_DAMPING = 0.01
"""Information that holds every pose [1/m^2], for directions that no wall determines, as along a corridor."""
_PRIOR = np.array([0.1, 0.3, 0.1]) ** -2.0
"""Prior information of the parameters, from the largest plausible errors."""
_SHIFT = 0.382
"""Shift of the cells of wall pieces in each round, as a share of a cell, so that no fixed cell borders matter."""


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
    hits: int = Field(180, ge=10, description="approximate number of hits of a scan that are used")
    deviation: float = Field(0.03, gt=0, description="standard deviation of a hit from its wall [m]")
    trust: float = Field(
        0.01, gt=0, le=1, description="weight of the tracked motions, which share the errors of the laser"
    )
    notable_scale: float = Field(
        0.002, gt=0, description="relative error of the angle step in the first round that asks for more rounds"
    )
    notable_offset: float = Field(0.02, gt=0, description="range offset that asks for more rounds [m]")
    rounds: int = Field(12, ge=1, description="largest number of rounds")


class SelfCalibration:
    """One part of a drive, whose poses and laser parameters are improved round by round.

    Parameters
    ----------
    keyframes, poses, steps
        The whole drive, as of `tbmslam.calibration.laser_check.fit_laser`.
    rates
        Rotation rate of the laser at each keyframe (K,), positive in the direction of the beams [rad/s].
    scans
        The keyframes (N >= 2,) of this part.
    config, pieces
        The parameters of the fit, and of wall pieces.
    """

    def __init__(
        self,
        keyframes: Keyframes,
        poses: FloatArray,
        steps: Sequence[MotionEdge],
        rates: FloatArray,
        scans: npt.NDArray[np.int64],
        config: LaserFitConfig,
        pieces: AdjustmentConfig,
    ) -> None:
        self._pieces = pieces.model_copy(update={"deviation": config.deviation})
        self._hits, self._begins = single_scan_hits(
            *(keyframes.ranges, keyframes.offsets, keyframes.beams, keyframes.beam_steps),
            *(scans, config.hits, (config.max_range, pieces.gap, pieces.bulge)),
        )
        first, last = int(scans[0]), int(scans[-1])
        between = MotionChain(steps[first:last]).between(scans - first)
        self._motions = motions_of(
            [
                MotionEdge(k, k + 1, edge.T_source_target, config.trust * edge.information)
                for k, edge in enumerate(between)
            ],
            [],
            1.0,
            np.arange(len(scans)),
            np.zeros((len(scans), 3)),
        )
        self._poses = poses[scans]
        self._rates = rates[scans]
        self._bends = bends_of([0, len(scans)])
        self._held = np.tile(_DAMPING * np.eye(3), (len(scans), 1, 1))
        self._held[0] += _GAUGE * np.eye(3)
        self._numbers = np.zeros(NUMBERS)
        self._round = 0

    def improved(self) -> tuple[FloatArray, FloatArray]:
        """Do one round; return the parameters (M,) and their information (M, M)."""
        pieces, numbers, at = self._pieces, self._numbers, self._poses
        scales = numbers[SCALE] + numbers[SWEEP] * self._rates
        hits = bent_hits(self._hits, self._begins, scales, float(numbers[OFFSET]))
        walls = WallLines(hits, 1, at, self._round * _SHIFT % 1.0 * pieces.cell, pieces)
        own, motions, pull = motion_equations(self._motions, at)
        solver = PoseSolver(
            PoseSystem(walls.own + own + self._held, walls.system, motions), at, self._bends, pieces.precision
        )
        limits = pieces.enough, pieces.deviation, pieces.robust_width
        laser = laser_equations(hits, self._hits[:, 2], self._rates, at, walls.seen, walls.system, limits)
        gradient = walls.gradient + pull
        # The Schur complement of the poses, in a form whose error is the square of the solver's.
        following = [solver.solved(np.ascontiguousarray(laser.across[:, :, j])) for j in range(NUMBERS)]
        follow = np.array(following).reshape(NUMBERS, -1)
        curved = np.array([solver.curved(changes) for changes in following]).reshape(NUMBERS, -1)
        across = laser.across.reshape(-1, NUMBERS)
        information = laser.own - follow @ across - (follow @ across).T + follow @ curved.T
        slope = laser.gradient - follow @ gradient.ravel()
        change = -np.linalg.solve(information + np.diag(_PRIOR), slope + _PRIOR * numbers)
        moved = solver.solved(gradient) + (follow.T @ change).reshape(-1, 3)
        self._poses = at - moved
        self._poses[:, 2] = wrap_angles(self._poses[:, 2])
        self._numbers = numbers + change
        self._round += 1
        return self._numbers, information + np.diag(_PRIOR)
