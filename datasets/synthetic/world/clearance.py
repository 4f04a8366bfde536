"""How far walls are from every point of a world, and ways that keep off them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse, spatial
from scipy.sparse import csgraph

from datasets.synthetic.world.world import World
from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE
from tbmslam.geometry.se2 import FloatArray

COMFORTABLE = 1.0
"""Clearance from which on a way costs no more than its length [m]."""

_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True)
class ClearanceMap:
    """Distance to the nearest wall on a grid.

    Parameters
    ----------
    geometry
        The grid's cells.
    clearance
        Distances (rows, cols) [m]; 0 outside the inside of the world.
    """

    geometry: GridGeometry
    clearance: FloatArray

    @classmethod
    def of(cls, world: World, resolution: float = 0.05) -> "ClearanceMap":
        """Measure a world."""
        geometry = world.grid(resolution)
        free = world.occupancy(geometry) == FREE
        # From cell centres to the nearest wall cell's near side
        distance = np.asarray(ndimage.distance_transform_edt(free)) * resolution - resolution / 2.0
        return cls(geometry, np.maximum(distance, 0.0))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the clearance (N,) at points (N, 2) [m]; 0 off the grid."""
        rows, cols, inside = self.geometry.cells_at(points)
        return np.where(inside, self.clearance[rows, cols], 0.0)


class RoadMap:
    """Where a robot can drive, as a graph of neighbouring points, and its cheapest ways.

    Parameters
    ----------
    clearance_map
        The world.
    smallest
        Clearance below which no way leads [m].
    rng
        Draws a robot's whims, which make some lines look longer to it than others; None for none.
    """

    def __init__(self, clearance_map: ClearanceMap, smallest: float, rng: np.random.Generator | None = None) -> None:
        g, step = clearance_map.geometry, 2
        clearance = clearance_map.clearance[::step, ::step]
        drivable = _largest_region(clearance >= smallest)
        rows, cols = np.nonzero(drivable)
        self.points = g.centres_of(rows * step, cols * step)
        cost = 1.0 + 4.0 * np.maximum(0.0, 1.0 - clearance / COMFORTABLE) ** 2
        if rng is not None:
            whims = ndimage.gaussian_filter(rng.standard_normal(clearance.shape), 6.0)
            cost *= np.exp(0.5 * whims / whims.std())
        self._tree = spatial.KDTree(self.points)
        self._graph = _graph(drivable, cost * g.resolution * step)

    def nearest(self, points: FloatArray) -> npt.NDArray[np.int64]:
        """Return the node (N,) nearest to each of points (N, 2)."""
        return np.asarray(self._tree.query(points)[1], dtype=np.int64)

    def costs(self, nodes: npt.NDArray[np.int64]) -> FloatArray:
        """Return the cost (K, K) of the cheapest ways between nodes, about their length [m]."""
        return np.asarray(csgraph.dijkstra(self._graph, directed=False, indices=nodes)[:, nodes])

    def path(self, start: int, end: int) -> FloatArray:
        """Return the points (P, 2) of the cheapest way between two nodes, both included."""
        apart = float(np.hypot(*(self.points[start] - self.points[end])))
        for limit in (3.0 * apart + 10.0, np.inf):  # most ways are short, and then few nodes need a look
            _, before = csgraph.dijkstra(
                self._graph, directed=False, indices=[end], return_predecessors=True, limit=limit
            )
            if start == end or before[0, start] >= 0:
                break
        nodes = [start]
        while nodes[-1] != end:
            nodes.append(int(before[0, nodes[-1]]))
        return np.asarray(self.points[nodes])


def _largest_region(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    regions, _ = ndimage.label(mask)
    return np.asarray(regions == np.bincount(regions.ravel())[1:].argmax() + 1)


def _graph(drivable: npt.NDArray[np.bool_], cost: FloatArray) -> sparse.csr_array:
    """Join drivable cells to their eight neighbours; passing between two cells costs the mean of both a cell."""
    number = np.full(drivable.shape, -1)
    number[drivable] = np.arange(int(drivable.sum()))
    starts, ends, weights = [], [], []
    for rows, cols in _NEIGHBOURS:
        height, width = drivable.shape[0] - rows, drivable.shape[1] - abs(cols)
        here = (slice(0, height), slice(max(0, -cols), max(0, -cols) + width))
        there = (slice(rows, rows + height), slice(max(0, cols), max(0, cols) + width))
        both = drivable[here] & drivable[there]
        starts.append(number[here][both])
        ends.append(number[there][both])
        weights.append((cost[here][both] + cost[there][both]) / 2.0 * np.hypot(rows, cols))
    nodes = int(drivable.sum())
    edges = (np.concatenate(starts), np.concatenate(ends))
    return sparse.csr_array((np.concatenate(weights), edges), shape=(nodes, nodes))
