"""All of a drive and all walls that it saw, adjusted to each other at once, after loops are closed.

A tracker lays each scan onto what it knows by then, and errors of millimetres add up along corridors where nothing
closes. Here every straight piece of wall is one line that all stretches of the drive that saw it must agree on, before
and after, and the lines and poses that fit best are sought together: bundle adjustment (Triggs et al., 2000), with
lines as Liu and Zhang (BALM, 2021) and Zhou et al. (2021) use planes.
"""

import itertools
import logging
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import FloatArray, compose, inverse, path_lengths, wrap_angles
from tbmslam.kernels.adjustment.laser_slopes import SeenLines
from tbmslam.kernels.adjustment.line_adjustment import (
    fit_lines,
    line_equations,
)
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.kernels.adjustment.two_levels import Factors
from tbmslam.kernels.adjustment.wall_pieces import (
    Raster,
    StretchHits,
    gather_hits,
    join_walls,
    see_walls,
    sort_sightings,
)
from tbmslam.map.drive import spread_corrections
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge
from tbmslam.optimisation.pose_solver import PoseSolver, bends_of, motions_of

logger = logging.getLogger(__name__)

_GAUGE = 1e8
"""Information that holds the first pose where it is [1/m^2]."""
_DAMPING = 1.0
"""Of every pose: no step goes farther than about a metre or a radian [1/m^2]."""
_QUICK = 3
"""Every so manieth hit is enough in quick rounds."""
_SHIFT = 0.382
"""Of a cell, by which cells begin elsewhere in each round, so that where they begin decides nothing."""
_MOST_HITS = 4_000_000
"""So many of all keyframes together are enough; half a gigabyte holds what is made of them."""
_REACH = 2.0
"""Deviations within which a hit whose normal is not known may lie on a line."""


class AdjustmentConfig(FrozenConfig):
    """Joint optimisation of poses and wall lines."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="optimise poses and wall lines after loop closure")
    quick_rounds: int = Field(5, ge=0, description="how often a third of the hits is assigned to pieces of wall")
    rounds: int = Field(1, ge=1, description="how often all hits are, after that")
    stretch: float = Field(1.0, gt=0, description="travelled length that moves as one [m]")
    turn: float = Field(1.0, gt=0, description="turned angle that moves as one [rad]")
    max_range: float = Field(
        30.0, gt=0, description="hits beyond this, or beyond what loops are closed by, are not used [m]"
    )
    hits: int = Field(200, ge=10, description="hits of a keyframe that are used, about")
    gap: float = Field(0.5, gt=0, description="between the neighbours of a hit at the most [m]")
    bulge: float = Field(0.03, gt=0, description="of a hit from the line between its neighbours at the most [m]")
    cell: float = Field(0.3, gt=0, description="side of a cell that holds one piece of wall in a direction [m]")
    sectors: int = Field(8, ge=4, description="directions of walls that are told apart")
    min_hits: float = Field(5.0, gt=0, description="hits of a piece of wall, those of one sighting counted as below")
    enough: float = Field(10.0, gt=0, description="hits of one sighting of a piece, from which on more tell little")
    thickness: float = Field(0.08, gt=0, description="standard deviation across a piece of wall at the most [m]")
    length: float = Field(0.03, gt=0, description="standard deviation along a piece of wall at the least [m]")
    deviation: float = Field(0.05, gt=0, description="of a hit from its wall [m]")
    robust_width: float = Field(2.0, gt=0, description="deviations at which a sighting begins to lose its say")
    precision: float = Field(1e-2, gt=0, lt=1, description="share of the equations' right side left unsolved")


def adjust(
    poses: FloatArray,
    drives: Sequence[ScanHits],
    chain: Sequence[MotionEdge],
    closures: Sequence[MotionEdge],
    closure_width: float,
    config: AdjustmentConfig,
) -> FloatArray:
    """Return poses (K, 3) that bring what all keyframes saw of each wall onto one line.

    Parameters
    ----------
    poses
        Poses (K, 3) of the laser at the keyframes of all drives, one drive after the other; the first hardly moves.
    chain
        Motions between keyframes that are believed; those from each keyframe of a drive to its next come in order.
    closures
        Motions between keyframes that saw the same place.
    closure_width
        Standard deviations at which a closure begins to lose its say.
    config
        What a piece of wall is, and how well it is known.
    """
    stretches = RigidStretches(poses, [len(scans) for scans in drives], config)
    steps = [edge for edge in chain if edge.target == edge.source + 1]
    others = [edge for edge in chain if edge.target != edge.source + 1]
    believed = [*stretches.between(steps), *others]
    motions = motions_of(believed, closures, closure_width, stretches.owners, stretches.places)
    bends = bends_of(stretches.ends)
    hits = stretches.hits(drives, config)
    held = np.tile(_DAMPING * np.eye(3), (len(stretches.middles), 1, 1))
    held[0] += _GAUGE * np.eye(3)
    before = at = poses[stretches.middles]
    factors: Factors | None = None
    for number in range(config.quick_rounds + config.rounds):
        every = _QUICK if number < config.quick_rounds else 1
        fewer = config.model_copy(update={"min_hits": config.min_hits / every})
        lines = WallLines(hits, every, at, number * _SHIFT % 1.0 * config.cell, fewer)
        own, between, pull = motion_equations(motions, at)
        system = PoseSystem(lines.own + own + held, lines.system, between)
        solver = PoseSolver(system, at, bends, config.precision, factors)
        factors = solver.factors
        at = at - solver.solved(lines.gradient + pull)
        at[:, 2] = wrap_angles(at[:, 2])
    moved_m = float(np.sqrt(((at - before)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("laying %d stretches onto %d pieces of wall moved them by %.3f m", len(at), lines.count, moved_m)
    return stretches.moved(at)


class RigidStretches:
    """The stretches of some drives.

    Parameters
    ----------
    poses
        Poses (K, 3) of the laser at the keyframes of all drives, one drive after the other.
    counts
        How many keyframes each drive has.
    config
        How long a stretch is.

    Attributes
    ----------
    middles
        The keyframe (N,) whose pose stands for each stretch.
    owners
        The stretch (K,) of each keyframe.
    ends
        Which stretch is each drive's first, and where the last one's end (D + 1,).
    places
        Poses (K, 3) of the keyframes in their stretches' frames.
    """

    def __init__(self, poses: FloatArray, counts: Sequence[int], config: AdjustmentConfig) -> None:
        self._poses = poses
        self._drive_ends = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        begins = [first + stretch_begins(poses[first:last], config) for first, last in self._drives()]
        self._starts = starts = np.concatenate(begins)
        ends = np.append(starts[1:], len(poses))
        self.ends = np.cumsum([0, *map(len, begins)]).tolist()
        self.middles: npt.NDArray[np.int64] = (starts + ends - 1) // 2
        self.owners: npt.NDArray[np.int64] = np.repeat(np.arange(len(starts)), ends - starts)
        self.places = compose(inverse(poses[self.middles][self.owners]), poses)

    def between(self, chain: Sequence[MotionEdge]) -> list[MotionEdge]:
        """Return the motions from the middle of each stretch to that of the next of its drive.

        `chain` are those from each keyframe to the next, without any from one drive to another.
        """
        motions, begin = list[MotionEdge](), 0
        for number, (first, last) in enumerate(self._drives()):
            own = chain[begin : begin + last - first - 1]
            begin += len(own)
            middles = self.middles[self.ends[number] : self.ends[number + 1]]
            motions += [
                MotionEdge(first + edge.source, first + edge.target, edge.T_source_target, edge.information)
                for edge in MotionChain(own).between(middles - first)
            ]
        return motions

    def hits(self, drives: Sequence[ScanHits], config: AdjustmentConfig) -> StretchHits:
        """Return what the stretches hit."""
        of_each = min(config.hits, max(_MOST_HITS // len(self._poses), 1))
        parts, limits = [], (config.max_range, config.gap, config.bulge)
        for scans, (first, last) in zip(drives, self._drives(), strict=True):
            every = max(len(scans.points) // (of_each * max(len(scans), 1)), 1)
            places = self.places[first:last]
            part, sines = gather_hits(scans.points, scans.normals, scans.offsets, places, every, limits)
            part.walls[:, 2] = np.arctan2(sines, part.walls[:, 2])
            parts.append(part)
        return StretchHits(
            _stacked([part.walls for part in parts]),
            self._begins([part.wall_begins for part in parts]),
            _stacked([part.loose for part in parts]),
            self._begins([part.loose_begins for part in parts]),
        )

    def _begins(self, of_keyframes: Sequence[npt.NDArray[np.int64]]) -> npt.NDArray[np.int64]:
        """Return where the hits of each stretch begin, where those of the keyframes of each drive are known."""
        begins = np.zeros(1, dtype=np.int64)
        for own in of_keyframes:
            begins = np.concatenate((begins, begins[-1] + own[1:]))
        of_stretches: npt.NDArray[np.int64] = begins[np.append(self._starts, len(self._poses))]
        return of_stretches

    def moved(self, stretches: FloatArray) -> FloatArray:
        """Return the poses (K, 3) of the keyframes where the stretches are at other poses (N, 3)."""
        parts = []
        for number, (first, last) in enumerate(self._drives()):
            own = slice(self.ends[number], self.ends[number + 1])
            parts.append(spread_corrections(self._poses[first:last], self.middles[own] - first, stretches[own]))
        return np.vstack(parts)

    def _drives(self) -> list[tuple[int, int]]:
        return list(itertools.pairwise(self._drive_ends.tolist()))


def _stacked(parts: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Return rows of drives one after the other; those of a single one are not copied."""
    return parts[0] if len(parts) == 1 else np.vstack(parts)


def stretch_begins(poses: FloatArray, config: AdjustmentConfig) -> npt.NDArray[np.int64]:
    """Return the keyframes of a drive at which stretches begin."""
    turns = np.cumsum(np.abs(wrap_angles(np.diff(poses[:, 2], prepend=poses[:1, 2]))))
    marks = np.column_stack((path_lengths(poses) // config.stretch, turns // config.turn))
    return np.flatnonzero(np.concatenate(([True], (marks[1:] != marks[:-1]).any(axis=1)))).astype(np.int64)


class WallLines:
    """The equations that lay hits onto straight pieces of wall, which turn and shift along with the poses.

    Hits whose normals are known make the lines; others, seen from afar or near an edge, join those near which they lie.

    Parameters
    ----------
    every
        Every so manieth is used.
    poses
        Poses (N, 3) of the stretches.
    shift
        Where cells begin [m].
    config
        What a piece of wall is.

    Attributes
    ----------
    count
        How many pieces there are.
    seen
        The lines, and what they were made of.
    own, system, gradient
        As of `tbmslam.kernels.adjustment.line_adjustment.line_equations`.
    """

    def __init__(
        self,
        hits: StretchHits,
        every: int,
        poses: FloatArray,
        shift: float,
        config: AdjustmentConfig,
    ) -> None:
        raster = Raster(config.cell, shift, config.sectors)
        seen, known = see_walls(hits, every, poses, raster)
        limits = np.array([config.min_hits, config.thickness, config.length])
        lines = fit_lines(seen, poses, config.enough, limits)
        seen = join_walls(hits, every, poses, raster, seen, known, lines, _REACH * config.deviation)
        lines = fit_lines(seen, poses, config.enough, limits)
        is_line = lines[:, 4] > 0.0
        lines, numbers = lines[is_line], np.where(is_line, np.cumsum(is_line) - 1, -1)
        self.count = len(lines)
        moments, seers, begins = sort_sightings(seen, numbers, self.count)
        self.seen = SeenLines(raster, known, numbers, moments, seers, begins, lines)
        self.own, self.system, self.gradient = line_equations(
            moments, seers, begins, lines, poses, config.enough, config.deviation, config.robust_width
        )
