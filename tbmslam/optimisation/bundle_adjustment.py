"""All of a drive and all walls that it saw, adjusted to each other at once, after loops are closed.

A tracker lays each scan onto what it knows by then, and errors of millimetres add up along corridors where nothing
closes. Here every straight piece of wall is one line that all stretches of the drive that saw it must agree on, before
and after, and the lines and poses that fit best are sought together: bundle adjustment (Triggs et al., 2000), with
lines as Liu and Zhang (BALM, 2021) and Zhou et al. (2021) use planes.
"""

import logging
from collections.abc import Sequence

import numpy as np

from tbmslam.geometry.se2 import FloatArray, wrap_angles
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import PoseSystem
from tbmslam.kernels.adjustment.two_levels import Factors
from tbmslam.map.scan_hits import ScanHits
from tbmslam.optimisation.config import AdjustmentConfig
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.optimisation.pose_solver import PoseSolver, bends_of, motions_of
from tbmslam.optimisation.trajectory_segments import RigidStretches
from tbmslam.optimisation.wall_lines import WallLines

logger = logging.getLogger(__name__)

_GAUGE = 1e8
"""Information that holds the first pose where it is [1/m^2]."""
_DAMPING = 1.0
"""Of every pose: no step goes farther than about a metre or a radian [1/m^2]."""
_QUICK = 3
"""Every so manieth hit is enough in quick rounds."""
_SHIFT = 0.382
"""Of a cell, by which cells begin elsewhere in each round, so that where they begin decides nothing."""


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
    drives
        What they hit.
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
