"""Agreement of a map with the truth, cell by cell, at the best registration."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, optimize

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray

Labels = npt.NDArray[np.uint8]
"""Label of each cell: FREE, OCCUPIED or UNKNOWN of `tbmslam.belief.masses`."""


@dataclass(frozen=True)
class MapAgreement:
    """Comparison of the cells of a map with the truth."""

    known_both: int
    known_map: int
    known_truth: int
    """Numbers of known cells: in both, in the map, in the truth."""
    agree: float
    """Share of the cells known in both with equal labels."""
    agree_nearby: float
    """The same with neighbours: the map's label is true of the cell or a neighbour, and the other way round. Grids that
    do not share cell borders have the same thin wall in different cells."""
    agree_occupied: float
    agree_free: float
    """Share of the map's occupied (free) cells that are truly so, among cells known to both; NaN if there are none."""
    found_occupied: float
    found_free: float
    """Share of the truly occupied (free) cells, of those known to both, that the map calls so; NaN if there are
    none."""
    wall_distance: float
    """Mean distance from the map's occupied cells, of those known to both, to the nearest true one [cells]: walls are
    thin, so half a cell of error moves many of them to the neighbour's cell. NaN if there are none."""


def cell_labels(grid: TbmGrid, min_evidence: float = 0.0) -> Labels:
    """Return the label of each cell (rows, cols) of a map by the larger mass: occupied or free.

    Cells are UNKNOWN if the sum of both masses, normalised without conflict, does not exceed `min_evidence`, or if they
    are equal.
    """
    labels = np.full(grid.cells.shape[:2], UNKNOWN, dtype=np.uint8)
    for rows, cols, masses in grid.pieces():
        free, occupied = masses[..., FREE], masses[..., OCCUPIED]
        evidence = free + occupied
        known = (evidence > min_evidence * (1.0 - masses[..., CONFLICT])) & (free != occupied)
        labels[rows, cols] = np.where(known, np.where(occupied > free, OCCUPIED, FREE), UNKNOWN)
    return labels


def map_agreement(labels: Labels, truth: Labels) -> MapAgreement:
    """Compare the labels (rows, cols) of a map with the true labels of the same cells."""
    if labels.shape != truth.shape:
        raise ValueError(f"labels and truth must have the same shape, got {labels.shape} and {truth.shape}")
    both = (labels != UNKNOWN) & (truth != UNKNOWN)
    same = both & (labels == truth)
    labelled = {label: both & (labels == label) for label in (FREE, OCCUPIED)}
    true = {label: both & (truth == label) for label in (FREE, OCCUPIED)}
    return MapAgreement(
        known_both=int(both.sum()),
        known_map=int((labels != UNKNOWN).sum()),
        known_truth=int((truth != UNKNOWN).sum()),
        agree=_share(same, both),
        agree_nearby=_share(_is_near(labels, truth) & _is_near(truth, labels), both),
        agree_occupied=_share(same, labelled[OCCUPIED]),
        agree_free=_share(same, labelled[FREE]),
        found_occupied=_share(same, true[OCCUPIED]),
        found_free=_share(same, true[FREE]),
        wall_distance=_mean_distance(labelled[OCCUPIED], truth == OCCUPIED),
    )


def _share(part: npt.NDArray[np.bool_], whole: npt.NDArray[np.bool_]) -> float:
    total = int(whole.sum())
    return int((part & whole).sum()) / total if total else float("nan")


def _is_near(labels: Labels, others: Labels) -> npt.NDArray[np.bool_]:
    """Return which cells (rows, cols) have their label in the other map, there or in one of eight neighbours."""
    near = np.zeros(labels.shape, dtype=np.bool_)
    for label in (FREE, OCCUPIED):
        near |= (labels == label) & ndimage.binary_dilation(others == label, np.ones((3, 3), dtype=np.bool_))
    return near


def _mean_distance(cells: npt.NDArray[np.bool_], targets: npt.NDArray[np.bool_]) -> float:
    if not cells.any() or not targets.any():
        return float("nan")
    distances: FloatArray = ndimage.distance_transform_edt(~targets)
    return float(distances[cells].mean())


REACHES = (1.0, 0.3, 0.1)
"""Three times the scale of the loss [m], from wide to narrow; the first also limits the distances."""

MAX_POINTS = 20_000
"""Occupied cells that are used, evenly chosen."""


class MapRefinementError(TbmSlamError):
    """One of the maps has no walls to align."""


def refine_map_transform(
    labels: Labels, geometry: GridGeometry, truth: Labels, truth_geometry: GridGeometry, T_truth_map: SE2
) -> SE2:
    """Refine T_truth_map, known to about a metre and a few degrees, so that the occupied cells match the true ones.

    Least squares on the distance to the nearest true wall (Fitzgibbon, "Robust registration of 2D and 3D point sets",
    2003), with a robust loss that narrows, so that walls missing in one map have no influence. Raises a
    `MapRefinementError` if a map has no occupied cell.
    """
    points = geometry.centres_of(*np.nonzero(labels == OCCUPIED))
    if not len(points) or not (truth == OCCUPIED).any():
        raise MapRefinementError(
            "one of the maps has no occupied cell, so the transform cannot be refined: give the exact transform"
        )
    points = points[:: -(-len(points) // MAX_POINTS)]
    margin = int(np.ceil(REACHES[0] / truth_geometry.resolution)) + 1
    distances = _wall_distances(truth, truth_geometry.resolution, margin)
    origin = np.array([truth_geometry.origin_x, truth_geometry.origin_y]) - margin * truth_geometry.resolution
    centre = points.mean(axis=0)  # decouples rotation and translation
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


def _wall_distances(truth: Labels, resolution: float, margin: int) -> FloatArray:
    """Return the distance [m] from each cell of the grid, grown by a margin on each side, to the nearest wall."""
    walls = np.pad(truth == OCCUPIED, margin)
    distances: FloatArray = ndimage.distance_transform_edt(~walls, sampling=resolution)
    return np.minimum(distances, REACHES[0])
