"""What stretches of drives saw of the walls, as straight pieces."""

import numpy as np
import numpy.typing as npt

from tbmslam.adjustment_config import AdjustmentConfig
from tbmslam.kernels.line_adjustment import (
    fit_lines,
    line_equations,
)
from tbmslam.kernels.wall_pieces import Raster, Sightings, StretchHits, join_walls, see_walls, sort_sightings
from tbmslam.se2 import FloatArray

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
    own, system, gradient
        As of `tbmslam.kernels.line_adjustment.line_equations`.
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
        pieces = int(seen.pieces.max(initial=-1)) + 1
        *_, lines = _fitted(seen, np.arange(pieces), pieces, poses, config)
        seen = join_walls(hits, every, poses, raster, seen, known, lines, _REACH * config.deviation)
        is_line = lines[:, 4] > 0.0
        numbers = np.where(is_line, np.cumsum(is_line) - 1, -1)
        moments, seers, begins, lines = _fitted(seen, numbers, int(is_line.sum()), poses, config)
        self.count = int(np.count_nonzero(lines[:, 4]))
        self.own, self.system, self.gradient = line_equations(
            moments, seers, begins, lines, poses, config.enough, config.deviation, config.robust_width
        )


def _fitted(
    seen: Sightings, numbers: npt.NDArray[np.int64], count: int, poses: FloatArray, config: AdjustmentConfig
) -> tuple[FloatArray, npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
    """Return moments, seers and begins of the sightings of pieces by new numbers, and the lines fitted to them."""
    moments, seers, begins = sort_sightings(seen, numbers, count)
    limits = np.array([config.min_hits, config.thickness, config.length])
    return moments, seers, begins, fit_lines(moments, seers, begins, poses, config.enough, limits)
