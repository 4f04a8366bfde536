"""How far a map says what is true: the same cells free, the same cells occupied."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import FloatArray

Labels = npt.NDArray[np.uint8]
"""What each cell is: FREE, OCCUPIED or UNKNOWN of `tbmslam.belief.masses`."""


@dataclass(frozen=True)
class MapAgreement:
    """A map's cells against the true ones.

    Parameters
    ----------
    known_both, known_map, known_truth
        Cells known to both, to the map, to the truth.
    agree
        Share of the cells known to both that both call the same.
    agree_nearby
        The same, a cell beside it counting too: what the map says is true of a cell no farther than a neighbour, and
        the other way round. Maps whose cells lie across one another put the same thin wall into other cells.
    agree_occupied, agree_free
        Share of the map's occupied (free) cells, of those known to both, that truly are; NaN where there are none.
    found_occupied, found_free
        Share of the truly occupied (free) cells, of those known to both, that the map calls so; NaN where there are
        none.
    wall_distance
        Mean distance from the map's occupied cells, of those known to both, to the nearest true one [cells]: walls are
        thin, so half a cell of error moves many of them to the neighbour's cell. NaN where there are none.
    """

    known_both: int
    known_map: int
    known_truth: int
    agree: float
    agree_nearby: float
    agree_occupied: float
    agree_free: float
    found_occupied: float
    found_free: float
    wall_distance: float


def cell_labels(grid: TbmGrid, min_evidence: float = 0.0) -> Labels:
    """Return what a map says of each cell (rows, cols): occupied or free, whichever mass is larger.

    Parameters
    ----------
    grid
        The map.
    min_evidence
        A cell whose mass of free and occupied, conflict normalised away, is not above this stays UNKNOWN.
    """
    free, occupied = grid.masses[..., FREE], grid.masses[..., OCCUPIED]
    evidence = free + occupied
    known = (evidence > min_evidence * (1.0 - grid.masses[..., CONFLICT])) & (free != occupied)
    return np.where(known, np.where(occupied > free, OCCUPIED, FREE), UNKNOWN).astype(np.uint8)


def map_agreement(labels: Labels, truth: Labels) -> MapAgreement:
    """Compare a map's cells with the true ones.

    Parameters
    ----------
    labels, truth
        What each cell (rows, cols) is, on the same cells.
    """
    if labels.shape != truth.shape:
        raise ValueError(f"labels and truth must have the same shape, got {labels.shape} and {truth.shape}")
    both = (labels != UNKNOWN) & (truth != UNKNOWN)
    same = both & (labels == truth)
    said = {label: both & (labels == label) for label in (FREE, OCCUPIED)}
    true = {label: both & (truth == label) for label in (FREE, OCCUPIED)}
    return MapAgreement(
        known_both=int(both.sum()),
        known_map=int((labels != UNKNOWN).sum()),
        known_truth=int((truth != UNKNOWN).sum()),
        agree=_share(same, both),
        agree_nearby=_share(_is_near(labels, truth) & _is_near(truth, labels), both),
        agree_occupied=_share(same, said[OCCUPIED]),
        agree_free=_share(same, said[FREE]),
        found_occupied=_share(same, true[OCCUPIED]),
        found_free=_share(same, true[FREE]),
        wall_distance=_mean_distance(said[OCCUPIED], truth == OCCUPIED),
    )


def _share(part: npt.NDArray[np.bool_], whole: npt.NDArray[np.bool_]) -> float:
    total = int(whole.sum())
    return int((part & whole).sum()) / total if total else float("nan")


def _is_near(labels: Labels, others: Labels) -> npt.NDArray[np.bool_]:
    """Tell of each cell (rows, cols) whether the others have its label there or in one of the eight cells around."""
    near = np.zeros(labels.shape, dtype=np.bool_)
    for label in (FREE, OCCUPIED):
        near |= (labels == label) & ndimage.binary_dilation(others == label, np.ones((3, 3), dtype=np.bool_))
    return near


def _mean_distance(cells: npt.NDArray[np.bool_], targets: npt.NDArray[np.bool_]) -> float:
    if not cells.any() or not targets.any():
        return float("nan")
    distances: FloatArray = ndimage.distance_transform_edt(~targets)
    return float(distances[cells].mean())
