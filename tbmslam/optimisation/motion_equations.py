"""Measured motions between poses as linear equations of small changes of the poses."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import FloatArray
from tbmslam.kernels.adjustment.motion_systems import Motions
from tbmslam.optimisation.pose_graph import MotionEdge


def motions_of(
    believed: Sequence[MotionEdge],
    doubted: Sequence[MotionEdge],
    width: float,
    owners: npt.NDArray[np.int64],
    places: FloatArray,
) -> Motions:
    """Return the motions between points of view that belong to poses, for `motion_systems.motion_equations`.

    Parameters
    ----------
    believed, doubted
        Motions between points of view.
    width
        Standard deviations at which a doubted one begins to lose its say (Cauchy).
    owners
        The pose (K,) that each point of view hangs on.
    places
        Where on it (K, 3).
    """
    edges = [*believed, *doubted]
    ends = np.array([(edge.source, edge.target) for edge in edges], dtype=np.int64).reshape(-1, 2)
    return Motions(
        ends=owners[ends],
        levers=places[ends],
        measured=np.array([edge.T_source_target for edge in edges], dtype=np.float64).reshape(-1, 3),
        informations=np.array([edge.information for edge in edges], dtype=np.float64).reshape(-1, 3, 3),
        widths=np.repeat([np.inf, width], [len(believed), len(doubted)]),
    )
