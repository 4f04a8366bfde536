"""All of a drive and all walls that it saw, adjusted to each other at once, after loops are closed.

A tracker lays each scan onto what it knows by then, and errors of millimetres add up along corridors where nothing
closes. Here every straight piece of wall is one line that all stretches of the drive that saw it must agree on, before
and after, and the lines and poses that fit best are sought together: bundle adjustment (Triggs et al., 2000), with
lines as Liu and Zhang (BALM, 2021) and Zhou et al. (2021) use planes.
"""

import logging
from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg, splu

from tbmslam.adjustment_config import AdjustmentConfig
from tbmslam.keyframes import Keyframes
from tbmslam.motion_equations import MotionEquations
from tbmslam.pose_graph import MotionEdge
from tbmslam.rigid_stretches import RigidStretches
from tbmslam.se2 import FloatArray, wrap_angles
from tbmslam.wall_lines import WallLines

logger = logging.getLogger(__name__)

_GAUGE = 1e8
"""Information that holds the first pose where it is [1/m^2]."""
_DAMPING = 1.0
"""Of every pose: no step goes farther than about a metre or a radian [1/m^2]."""
_MOST_STEPS = 1000
_QUICK = 3
"""Every so manieth hit is enough in quick rounds."""
_SHIFT = 0.382
"""Of a cell, by which cells begin elsewhere in each round, so that where they begin decides nothing."""


def adjust(
    poses: FloatArray,
    drives: Sequence[Keyframes],
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
        Their scans.
    chain
        Motions between keyframes that are believed; those from each keyframe of a drive to its next come in order.
    closures
        Motions between keyframes that saw the same place.
    closure_width
        Standard deviations at which a closure begins to lose its say.
    config
        What a piece of wall is, and how well it is known.
    """
    stretches = RigidStretches(poses, [len(keyframes) for keyframes in drives], config)
    steps = [edge for edge in chain if edge.target == edge.source + 1]
    others = [edge for edge in chain if edge.target != edge.source + 1]
    owners, places = stretches.owners, stretches.places
    believed = MotionEquations.of([*stretches.between(steps), *others], owners, places)
    doubted = MotionEquations.of(closures, owners, places)
    hits, of = stretches.hits(drives, config)
    before = at = poses[stretches.middles]
    for number in range(config.quick_rounds + config.rounds):
        every = _QUICK if number < config.quick_rounds else 1
        fewer = config.model_copy(update={"min_hits": config.min_hits / every})
        lines = WallLines(hits[::every], of[::every], at, number * _SHIFT % 1.0 * config.cell, fewer)
        (known, pull), (seen, tug) = believed.system(at, None), doubted.system(at, closure_width)
        at = at - _solved(lines, known + seen, lines.gradient + pull + tug, config.precision)
        at[:, 2] = wrap_angles(at[:, 2])
    moved_m = float(np.sqrt(((at - before)[:, :2] ** 2).sum(axis=1).mean()))
    logger.info("laying %d stretches onto %d pieces of wall moved them by %.3f m", len(at), lines.count, moved_m)
    return stretches.moved(at)


def _solved(lines: WallLines, motions: sparse.csr_array, gradient: FloatArray, precision: float) -> FloatArray:
    """Return the changes (N, 3) whose curvature product is the gradient (N, 3), by conjugate gradients.

    What the lines know of each pose by itself, and the motions, are solved exactly in each step.
    """
    size = gradient.size
    held = np.full(size, _DAMPING)
    held[:3] += _GAUGE
    alone = sparse.block_diag(list(lines.own_blocks()), format="csc")
    rest = (motions + sparse.diags_array(held)).tocsr()
    solver = splu((alone + rest).tocsc())

    def times(changes: FloatArray) -> FloatArray:
        return np.asarray(lines.times(changes.reshape(-1, 3)).ravel() + rest @ changes.ravel())

    system = LinearOperator((size, size), matvec=times, dtype=np.float64)
    near = LinearOperator((size, size), matvec=solver.solve, dtype=np.float64)
    changes, _ = cg(system, gradient.ravel(), rtol=precision, maxiter=_MOST_STEPS, M=near)
    return np.asarray(changes, dtype=np.float64).reshape(-1, 3)
