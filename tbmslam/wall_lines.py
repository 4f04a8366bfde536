"""What stretches of drives saw of the walls, as straight pieces."""

import numpy as np
import numpy.typing as npt

from tbmslam.adjustment_config import AdjustmentConfig
from tbmslam.kernels.line_adjustment import (
    apply_lines,
    eliminated_blocks,
    fit_lines,
    line_equations,
    turned_moments,
)
from tbmslam.kernels.wall_pieces import join_lines, pieces_of, sum_moments
from tbmslam.se2 import FloatArray

_REACH = 2.0
"""Deviations within which a hit whose normal is not known may lie on a line."""


class WallLines:
    """The equations that lay hits onto straight pieces of wall, which turn and shift along with the poses.

    Hits whose normals are known make the lines; others, seen from afar or near an edge, join those near which they lie.

    Parameters
    ----------
    hits, owners
        Points and normals (M, 4) in the frames of the stretches (M,) that saw them.
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
    gradient
        Half of that (N, 3) of the squared distances, by small changes dx, dy in the map's frame and dtheta.
    """

    def __init__(
        self,
        hits: FloatArray,
        owners: npt.NDArray[np.int64],
        poses: FloatArray,
        shift: float,
        config: AdjustmentConfig,
    ) -> None:
        pieces, cells = pieces_of(hits, owners, poses, config.cell, shift, config.sectors)
        *_, known, lines = _fitted(hits, owners, poses, pieces, config)
        reach = _REACH * config.deviation
        pieces = join_lines(hits, owners, poses, pieces, cells, known, lines, config.sectors, reach)
        turned, self._seers, self._begins, _, lines = _fitted(hits, owners, poses, pieces, config)
        self.count = int(np.count_nonzero(lines[:, 4]))
        self._blocks, self._couplings, self._inverses, self.gradient = line_equations(
            turned, self._seers, self._begins, lines, poses, config.enough, config.deviation, config.robust_width
        )

    def times(self, changes: FloatArray) -> FloatArray:
        """Return the curvature times changes (N, 3) of the poses."""
        return apply_lines(self._blocks, self._couplings, self._inverses, self._seers, self._begins, changes)

    def own_blocks(self) -> FloatArray:
        """Return the curvature (N, 3, 3) of each pose by itself."""
        return self._blocks - eliminated_blocks(
            self._couplings, self._inverses, self._seers, self._begins, len(self._blocks)
        )


def _fitted(
    hits: FloatArray,
    owners: npt.NDArray[np.int64],
    poses: FloatArray,
    pieces: npt.NDArray[np.int64],
    config: AdjustmentConfig,
) -> tuple[FloatArray, npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
    """Return turned moments, seers, begins and numbers of the pieces of hits, and the lines fitted to them."""
    order = np.argsort(pieces, kind="stable")
    some = order[np.searchsorted(pieces[order], 0) :]
    moments, seers, begins, known = sum_moments(hits, owners, pieces, some)
    turned = turned_moments(moments, seers, poses)
    limits = np.array([config.min_hits, config.thickness, config.length])
    return turned, seers, begins, known, fit_lines(turned, seers, begins, poses, config.enough, limits)
