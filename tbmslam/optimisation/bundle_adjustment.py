"""Bundle adjustment: the poses of a drive and the lines of all walls that it saw are optimised jointly.

A tracker registers each scan to the map so far, and errors of millimetres accumulate along corridors without loops.
Here every straight piece of wall is one line for all segments of the drive that saw it. Lines and poses are estimated
jointly (Triggs et al., 2000). The lines replace the planes of Liu and Zhang (BALM, 2021) and Zhou et al. (2021). Drives
are divided into short rigid segments, because a tracker is accurate over a metre.
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
from tbmslam.kernels.adjustment.line_adjustment import fit_lines, line_equations
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.kernels.adjustment.two_levels import Preconditioner
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
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge, PoseSolver, coarse_space_of, motions_of

logger = logging.getLogger(__name__)

_GAUGE = 1e8  # information that fixes the first pose [1/m^2]
_DAMPING = 1.0
"""Information that holds every pose, for directions that no wall determines, as along a corridor: a step is at most
about a metre or a radian [1/m^2]."""
_QUICK = 3  # quick rounds use every third hit
_SHIFT = 0.382  # shift of the cells in each round, as a share of a cell, so that no fixed cell borders matter
_MOST_HITS = 4_000_000  # largest number of hits of all keyframes; they take half a gigabyte
_REACH = 2.0  # standard deviations within which a hit without a normal may lie on a line


class AdjustmentConfig(FrozenConfig):
    """Joint optimisation of poses and wall lines."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="optimise poses and wall lines after loop closure")
    quick_rounds: int = Field(2, ge=0, description="rounds with a third of the hits")
    rounds: int = Field(1, ge=1, description="rounds with all hits after that")
    stretch: float = Field(1.0, gt=0, description="travelled length of a rigid segment [m]")
    turn: float = Field(1.0, gt=0, description="turned angle of a rigid segment [rad]")
    max_range: float = Field(30.0, gt=0, description="largest range of used hits, at most that of loop closing [m]")
    hits: int = Field(200, ge=10, description="approximate number of hits of a keyframe that are used")
    gap: float = Field(0.5, gt=0, description="largest distance between the neighbours of a hit [m]")
    bulge: float = Field(0.03, gt=0, description="largest distance of a hit from the line between them [m]")
    cell: float = Field(0.3, gt=0, description="side of a cell, which holds one piece of wall for each direction [m]")
    sectors: int = Field(8, ge=4, description="directions of walls that are distinguished")
    min_hits: float = Field(5.0, gt=0, description="least hits of a piece of wall, with the limit of `enough`")
    enough: float = Field(10.0, gt=0, description="largest number of hits of a sighting that count")
    thickness: float = Field(0.08, gt=0, description="largest standard deviation across a piece of wall [m]")
    length: float = Field(0.03, gt=0, description="least standard deviation along a piece of wall [m]")
    deviation: float = Field(0.05, gt=0, description="standard deviation of a hit from its wall [m]")
    robust_width: float = Field(2.0, gt=0, description="deviations from which a sighting loses weight")
    precision: float = Field(1e-2, gt=0, lt=1, description="share of the right side that is left unsolved")


def adjust(
    poses: FloatArray,
    drives: Sequence[ScanHits],
    chains: Sequence[MotionChain],
    closures: Sequence[MotionEdge],
    closure_width: float,
    config: AdjustmentConfig,
    others: Sequence[MotionEdge] = (),
) -> FloatArray:
    """Return the poses (K, 3) that fit the sightings of each wall to one line.

    `poses` (K, 3) are those of the laser at the keyframes of all drives, one drive after the other; the first hardly
    moves. `chains` are the trusted motions from each keyframe of a drive to the next, and `others` further trusted
    motions. `closures` are motions between keyframes that saw the same place; from `closure_width` standard deviations
    on they lose weight.
    """
    stretches = RigidStretches(poses, [len(scans) for scans in drives], config)
    believed = EdgeArrays.joined([stretches.between(chains), EdgeArrays.of(others)])
    motions = motions_of(believed, EdgeArrays.of(closures), closure_width, stretches.owners, stretches.places)
    coarse = coarse_space_of(stretches.ends)
    hits = stretches.hits(drives, config)
    held = held_poses(len(stretches.middles))
    before = at = np.column_stack((poses[stretches.middles, :2], wrap_angles(poses[stretches.middles, 2])))
    factors: Preconditioner | None = None
    for number in range(config.quick_rounds + config.rounds):
        every = _QUICK if number < config.quick_rounds else 1
        fewer = config.model_copy(update={"min_hits": config.min_hits / every})
        lines = WallLines(hits, every, at, number, fewer)
        own, between, pull = motion_equations(motions, at)
        system = PoseSystem(lines.own + own + held, lines.system, between)
        solver = PoseSolver(system, at, coarse, config.precision, factors)
        factors = solver.factors
        at = at - solver.solve(lines.gradient + pull)
        at[:, 2] = wrap_angles(at[:, 2])
    moved_m = float(np.sqrt(((at - before)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("laying %d stretches onto %d pieces of wall moved them by %.3f m", len(at), len(lines.lines), moved_m)
    return stretches.moved(at)


def held_poses(count: int) -> FloatArray:
    """Return the informations (count, 3, 3) that fix the first pose and hold every pose."""
    held = np.tile(_DAMPING * np.eye(3), (count, 1, 1))
    held[0] += _GAUGE * np.eye(3)
    return held


class RigidStretches:
    """Drives in short rigid segments ("stretches"), from poses (K, 3) of the laser at the keyframes of all drives.

    The pose of the keyframe `middles` (N,) represents each segment. `owners` (K,) is the segment of each keyframe, and
    `places` (K, 3) its pose in the frame of that segment. `ends` (D + 1,) are the first segment of each drive and the
    number of segments.
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

    def between(self, chains: Sequence[MotionChain]) -> EdgeArrays:
        """Return the motions from the middle of each segment to the middle of the next segment of its drive."""
        parts = []
        for number, ((first, _), chain) in enumerate(zip(self._drives(), chains, strict=True)):
            middles = self.middles[self.ends[number] : self.ends[number + 1]]
            own = chain.between(middles - first)
            parts.append(own._replace(ends=first + own.ends))
        return EdgeArrays.joined(parts)

    def hits(self, drives: Sequence[ScanHits], config: AdjustmentConfig) -> StretchHits:
        """Return the hits of the segments."""
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
        """Return the first hit of each segment, from the first hits of the keyframes of each drive."""
        begins = np.zeros(1, dtype=np.int64)
        for own in of_keyframes:
            begins = np.concatenate((begins, begins[-1] + own[1:]))
        of_stretches: npt.NDArray[np.int64] = begins[np.append(self._starts, len(self._poses))]
        return of_stretches

    def moved(self, stretches: FloatArray) -> FloatArray:
        """Return the poses (K, 3) of the keyframes after the segments moved to poses (N, 3)."""
        parts = []
        for number, (first, last) in enumerate(self._drives()):
            own = slice(self.ends[number], self.ends[number + 1])
            parts.append(spread_corrections(self._poses[first:last], self.middles[own] - first, stretches[own]))
        return np.vstack(parts)

    def _drives(self) -> list[tuple[int, int]]:
        return list(itertools.pairwise(self._drive_ends.tolist()))


def _stacked(parts: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Return the rows of all drives; rows of a single drive are not copied."""
    return parts[0] if len(parts) == 1 else np.vstack(parts)


def stretch_begins(poses: FloatArray, config: AdjustmentConfig) -> npt.NDArray[np.int64]:
    """Return the keyframes of a drive at which segments begin."""
    turns = np.cumsum(np.abs(wrap_angles(np.diff(poses[:, 2], prepend=poses[:1, 2]))))
    marks = np.column_stack((path_lengths(poses) // config.stretch, turns // config.turn))
    return np.flatnonzero(np.concatenate(([True], (marks[1:] != marks[:-1]).any(axis=1)))).astype(np.int64)


class WallLines:
    """The equations of hits on straight pieces of wall, whose lines move with the poses (N, 3) of the segments.

    Hits with normals define the lines. Other hits, seen from afar or near an edge, are used only if exactly one line of
    their cell fits. Every n-th hit is used. The `number` of a round determines the offset of its cells. For `lines`,
    their sightings, and the equations `own`, `system` and `gradient` see
    `tbmslam.kernels.adjustment.line_adjustment.line_equations`.
    """

    def __init__(self, hits: StretchHits, every: int, poses: FloatArray, number: int, config: AdjustmentConfig) -> None:
        raster = Raster(config.cell, number * _SHIFT % 1.0 * config.cell, config.sectors)
        seen, known = see_walls(hits, every, poses, raster)
        limits = np.array([config.min_hits, config.thickness, config.length])
        lines = fit_lines(seen, poses, config.enough, limits)
        seen = join_walls(hits, every, poses, raster, seen, known, lines, _REACH * config.deviation)
        lines = fit_lines(seen, poses, config.enough, limits)
        is_line = lines[:, 4] > 0.0
        self.lines, numbers = lines[is_line], np.where(is_line, np.cumsum(is_line) - 1, -1)
        self.moments, self.observers, self.begins = sort_sightings(seen, numbers, len(self.lines))
        self.own, self.system, self.gradient = line_equations(
            *(self.moments, self.observers, self.begins, self.lines, poses),
            *(config.enough, config.deviation, config.robust_width),
        )
