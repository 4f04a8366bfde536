"""What stretches of drives saw of the walls, as straight pieces."""

import numpy as np

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.adjustment.laser_slopes import SeenLines
from tbmslam.kernels.adjustment.line_adjustment import (
    fit_lines,
    line_equations,
)
from tbmslam.kernels.adjustment.wall_pieces import Raster, StretchHits, join_walls, see_walls, sort_sightings
from tbmslam.optimisation.config import AdjustmentConfig

_REACH = 2.0
"""Deviations within which a hit whose normal is not known may lie on a line."""


class WallLines:
    """The equations that lay hits onto straight pieces of wall, which turn and shift along with the poses.

    Hits whose normals are known make the lines; others, seen from afar or near an edge, join those near which they lie.

    Parameters
    ----------
    hits
        What the stretches hit.
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
