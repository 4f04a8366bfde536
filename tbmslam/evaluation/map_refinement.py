"""The rigid motion that lays one map's walls onto another's, from a guess nearby."""

import numpy as np
from scipy import ndimage, optimize

from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import OCCUPIED
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.map_agreement import Labels
from tbmslam.geometry.se2 import SE2, FloatArray

REACHES = (1.0, 0.3, 0.1)
"""Walls further apart than this have no say [m], from wide to narrow."""

MAX_POINTS = 20_000
"""Occupied cells that are used, evenly chosen."""


class MapRefinementError(TbmSlamError):
    """One of the maps has no walls to lay onto the other's."""


def refine_map_transform(
    labels: Labels, geometry: GridGeometry, truth: Labels, truth_geometry: GridGeometry, T_truth_map: SE2
) -> SE2:
    """Move a map so that its occupied cells come to lie on the true ones.

    Least squares on the distance to the nearest true wall (Fitzgibbon, "Robust registration of 2D and 3D point sets",
    2003), with a robust loss that narrows: what is missing in one map does not pull.

    Parameters
    ----------
    labels, geometry
        What each cell of the map is, and where the cells lie.
    truth, truth_geometry
        The same of the map that stays.
    T_truth_map
        Guess, good to about a metre and a few degrees.

    Returns
    -------
    The refined T_truth_map.

    Raises
    ------
    MapRefinementError
        When one of the maps has no occupied cell.
    """
    points = _occupied_centres(labels, geometry)
    if not len(points) or not (truth == OCCUPIED).any():
        raise MapRefinementError("one of the maps has no occupied cell to refine the transform by: give it exactly")
    points = points[:: -(-len(points) // MAX_POINTS)]
    margin = int(np.ceil(REACHES[0] / truth_geometry.resolution)) + 1
    distances = _wall_distances(truth, truth_geometry.resolution, margin)
    origin = np.array([truth_geometry.origin_x, truth_geometry.origin_y]) - margin * truth_geometry.resolution
    centre = points.mean(axis=0)  # turning about it keeps turn and shift apart
    x, y = T_truth_map.apply(centre)
    parameters = np.array([x, y, T_truth_map.theta])

    def residuals(values: FloatArray) -> FloatArray:
        moved = SE2.from_array(values).apply(points - centre)
        cells = (moved - origin) / truth_geometry.resolution - 0.5
        read: FloatArray = ndimage.map_coordinates(distances, cells[:, ::-1].T, order=1, mode="nearest")
        return read

    for reach in REACHES:
        parameters = optimize.least_squares(residuals, parameters, loss="cauchy", f_scale=reach / 3.0).x
    refined = SE2.from_array(parameters)
    shift_x, shift_y = refined.apply(-centre)
    return SE2(float(shift_x), float(shift_y), refined.theta)


def _occupied_centres(labels: Labels, geometry: GridGeometry) -> FloatArray:
    return geometry.centres_of(*np.nonzero(labels == OCCUPIED))


def _wall_distances(truth: Labels, resolution: float, margin: int) -> FloatArray:
    """Return the distance [m] from each cell of the grid, grown by a margin on each side, to the nearest wall."""
    walls = np.pad(truth == OCCUPIED, margin)
    distances: FloatArray = ndimage.distance_transform_edt(~walls, sampling=resolution)
    return np.minimum(distances, REACHES[0])
