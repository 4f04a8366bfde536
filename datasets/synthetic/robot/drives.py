"""Drives of robots: paths at a distance from walls, and tours of all places that are divided among robots."""

import math
from array import array
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage, spatial
from scipy.sparse import csgraph

from datasets.synthetic.world.world import World, graph_of_cells
from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE
from tbmslam.geometry.se2 import SE2, BoolArray, FloatArray, IntArray
from tbmslam.geometry.trajectory import Trajectory

COMFORTABLE = 1.0
"""Least clearance at which a path costs its length [m]."""


@dataclass(frozen=True)
class ClearanceMap:
    """Distance to the nearest wall on a grid."""

    geometry: GridGeometry
    clearance: FloatArray
    """Distances (rows, cols) [m]; 0 outside of the world."""

    @classmethod
    def of(cls, world: World, resolution: float = 0.05) -> "ClearanceMap":
        """Measure a world."""
        geometry = world.grid(resolution)
        free = world.occupancy(geometry) == FREE
        # From cell centres to the nearest side of the nearest wall cell
        distance = np.asarray(ndimage.distance_transform_edt(free)) * resolution - resolution / 2.0
        return cls(geometry, np.maximum(distance, 0.0))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the clearance (N,) at points (N, 2) [m]; 0 off the grid."""
        rows, cols, inside = self.geometry.cells_at(points)
        return np.where(inside, self.clearance[rows, cols], 0.0)


class RoadMap:
    """A graph of neighbouring points with at least the `smallest` clearance [m], and its cheapest paths.

    The random generator draws a robot's preferences for some edges.
    """

    def __init__(self, clearance_map: ClearanceMap, smallest: float, rng: np.random.Generator | None = None) -> None:
        g, step = clearance_map.geometry, 2
        clearance = clearance_map.clearance[::step, ::step]
        drivable = _largest_region(clearance >= smallest)
        rows, cols = np.nonzero(drivable)
        self.points = g.centres_of(rows * step, cols * step)
        cost = 1.0 + 4.0 * np.maximum(0.0, 1.0 - clearance / COMFORTABLE) ** 2
        if rng is not None:
            preferences = ndimage.gaussian_filter(rng.standard_normal(clearance.shape), 6.0)
            cost *= np.exp(0.5 * preferences / preferences.std())
        self._tree = spatial.KDTree(self.points)
        self._graph = graph_of_cells(drivable, cost * g.resolution * step)

    def nearest(self, points: FloatArray) -> IntArray:
        """Return the node (N,) nearest to each of points (N, 2)."""
        return np.asarray(self._tree.query(points)[1], dtype=np.int64)

    def costs(self, nodes: IntArray) -> FloatArray:
        """Return the costs (K, K) of the cheapest paths between nodes, about their length [m]."""
        return np.asarray(csgraph.dijkstra(self._graph, directed=False, indices=nodes)[:, nodes])

    def path(self, start: int, end: int) -> FloatArray:
        """Return the points (P, 2) of the cheapest path between two nodes, including both."""
        apart = float(np.hypot(*(self.points[start] - self.points[end])))
        for limit in (3.0 * apart + 10.0, np.inf):  # most paths are short, and a limit saves the search of most nodes
            _, before = csgraph.dijkstra(
                self._graph, directed=False, indices=[end], return_predecessors=True, limit=limit
            )
            if start == end or before[0, start] >= 0:
                break
        nodes = [start]
        while nodes[-1] != end:
            nodes.append(int(before[0, nodes[-1]]))
        return np.asarray(self.points[nodes])


def _largest_region(mask: BoolArray) -> BoolArray:
    regions, _ = ndimage.label(mask)
    return np.asarray(regions == np.bincount(regions.ravel())[1:].argmax() + 1)


RATE = 50.0
"""Rate of the samples of a drive [Hz]."""

LOOK_AHEAD = 0.3
"""Distance to the point of the path towards which the robot steers [m]."""

TURN_RATE = 0.9
"""Largest turn rate [rad/s]."""

_FORWARD_GAIN = 0.6 / RATE  # largest change of speed in a step [m/s]
_TURN_GAIN = 3.0 / RATE  # largest change of turn rate in a step [rad/s]
_SPEED_PERIOD = 8.0  # time between changes of the speed factor [s]


def drive_along(
    path: FloatArray,
    speed: float,
    rng: np.random.Generator,
    start_stamp: float,
    length: float = math.inf,
    duration: float = math.inf,
) -> Trajectory:
    """Return the drive along a path (P, 2) [m] of closely spaced points, at 50 Hz, facing along it at the start.

    Between poses the twist is constant. Pure pursuit (Coulter, "Implementation of the pure pursuit path tracking
    algorithm", CMU-RI-TR-92-01) with a forward speed that decreases with the angle to the pursued point, so that the
    robot turns on the spot where the path reverses. The largest speed varies between 60 and 100 % of `speed` [m/s]. The
    drive ends after a length [m] or a duration [s], or at the end of the path.
    """
    target = _pursued_index(path, 0, path[0, 0], path[0, 1])
    dx, dy = path[target] - path[0]
    pose = SE2(float(path[0, 0]), float(path[0, 1]), math.atan2(dy, dx))
    poses = array("d", pose)  # plain numbers: a day has millions of poses
    forward, turn, travelled, factor = 0.0, 0.0, 0.0, 1.0
    while travelled < length and len(poses) // 3 <= duration * RATE:
        target = _pursued_index(path, target, pose.x, pose.y)
        ahead = pose.inverse().apply(path[target])
        if target == len(path) - 1 and math.hypot(*ahead) < 0.05:
            break
        if (len(poses) // 3 - 1) % round(_SPEED_PERIOD * RATE) == 0:
            factor = float(rng.uniform(0.6, 1.0))
        error = math.atan2(ahead[1], ahead[0])
        target_speed = factor * speed * max(0.0, math.cos(error)) ** 4 if abs(error) < 0.8 else 0.0
        target_speed = min(target_speed, max(0.1, 1.5 * math.hypot(*ahead)))
        forward += min(max(target_speed - forward, -2.0 * _FORWARD_GAIN), _FORWARD_GAIN)
        target_turn = min(max(2.5 * error, -TURN_RATE), TURN_RATE)
        turn += min(max(target_turn - turn, -_TURN_GAIN), _TURN_GAIN)
        pose = pose @ SE2.exp(forward / RATE, 0.0, turn / RATE)
        travelled += forward / RATE
        poses.extend(pose)
    return Trajectory(start_stamp + np.arange(len(poses) // 3) / RATE, np.array(poses).reshape(-1, 3))


def _pursued_index(path: FloatArray, index: int, x: float, y: float) -> int:
    """Return the index of the first point from `index` on beyond the look-ahead distance."""
    while index < len(path) - 1 and math.hypot(path[index, 0] - x, path[index, 1] - y) < LOOK_AHEAD:
        index += 1
    return index


START_STAMP = 1_300_000_000.0
"""Begin of every simulated recording [s], in March 2011."""

PLANNED_CLEARANCE = 0.42
"""Least distance of planned paths from walls [m]; the robot may cut corners."""

AVERAGE_SPEED = 0.67
"""Mean speed of a drive as a share of the largest speed; turns and doors cost time."""


_MOST_ROBOTS = 1000  # limit of memory: all robots are simulated before the first is written

COST_PER_METRE = 1.2
"""Approximate cost of a metre in a road map."""


def plan_drives(
    world: World,
    robots: int = 1,
    *,
    length: float | None = None,
    duration: float | None = None,
    overlap: float = 0.3,
    speed: float = 0.65,
    seed: int = 0,
) -> list[Trajectory]:
    """Return the true drives of robots through a world, at 50 Hz from `START_STAMP` on.

    A short closed tour visits all places of the world. Each robot drives a section of it, and neighbouring sections
    share the fraction `overlap`, in [0, 0.9]. Every second robot drives in the opposite direction, and each prefers
    other paths.

    A drive ends at a `length` [m] or a `duration` [s], whichever comes first. With neither, the sections cover the
    tour, and a single robot returns to its start. `speed` is the largest speed [m/s]. `seed` determines the start of
    the tour and all random choices.
    """
    _check(robots, length, duration, overlap, speed)
    clearance_map = ClearanceMap.of(world)
    shared = RoadMap(clearance_map, PLANNED_CLEARANCE)
    stops = _stops(shared, world.places)
    costs = shared.costs(stops)
    rng = np.random.default_rng([seed, 11])
    tour = short_tour(costs, start=int(rng.integers(len(stops))))
    around = np.concatenate(([0.0], np.cumsum(costs[tour, np.roll(tour, -1)])))
    stretch = _stretch(float(around[-1]), robots, length, duration, overlap, speed)
    # A drive that ends at a length or duration needs a longer path.
    reserve = 0.0 if length is None and duration is None else 0.6 * stretch + 10.0
    drives = []
    for robot, robot_rng in enumerate(rng.spawn(robots)):
        begin = robot * stretch * (1.0 - overlap)
        backwards = robot % 2 == 1
        order = _stops_between(tour, around, begin - backwards * reserve, begin + stretch + (not backwards) * reserve)
        roads = RoadMap(clearance_map, PLANNED_CLEARANCE, robot_rng)
        path = _path(roads, stops[order[::-1] if backwards else order], robot_rng)
        drives.append(
            drive_along(
                _smoothed(path, clearance_map),
                speed,
                robot_rng,
                START_STAMP,
                math.inf if length is None else length,
                math.inf if duration is None else duration,
            )
        )
    return drives


def short_tour(costs: FloatArray, start: int = 0) -> IntArray:
    """Return a short closed tour (K,) of places with symmetric costs (K, K): nearest neighbours, then 2-opt."""
    left = set(range(len(costs))) - {start}
    tour = [start]
    while left:
        tour.append(min(left, key=lambda place: (costs[tour[-1], place], place)))
        left.remove(tour[-1])
    order = np.array(tour, dtype=np.int64)
    improved = True
    while improved:
        improved = False
        for i in range(1, len(order) - 1):
            before, first = order[i - 1], order[i]
            lasts, afters = order[i + 1 :], np.roll(order, -1)[i + 1 :]
            gains = costs[before, first] + costs[lasts, afters] - costs[before, lasts] - costs[first, afters]
            best = int(gains.argmax())
            if gains[best] > 1e-9:
                order[i : i + best + 2] = order[i : i + best + 2][::-1]
                improved = True
    return order


def _stops(roads: RoadMap, places: FloatArray) -> IntArray:
    """Return the nodes nearest to the places; places without a node nearby are left out."""
    nodes = roads.nearest(places)
    away = np.hypot(*(roads.points[nodes] - places).T)
    _, first = np.unique(nodes, return_index=True)
    return np.asarray(nodes[np.sort(first[away[first] < 1.5])])


def _stretch(
    tour: float, robots: int, length: float | None, duration: float | None, overlap: float, speed: float
) -> float:
    """Return the part of the tour that one robot drives, as cost."""
    lengths = [] if length is None else [length * COST_PER_METRE]
    if duration is not None:
        lengths.append(duration * speed * AVERAGE_SPEED * COST_PER_METRE)
    if lengths:
        return min(lengths)
    return tour if robots == 1 else tour / (robots * (1.0 - overlap))


def _stops_between(tour: IntArray, around: FloatArray, begin: float, end: float) -> IntArray:
    """Return the stops of the repeated tour from `begin` to `end`, at least two."""
    whole, stops = around[-1], len(tour)
    count = math.ceil((end - begin) / whole + 2) * stops
    index = np.arange(count)
    first_turn = math.floor(begin / whole)
    at = around[index % stops] + (first_turn + index // stops) * whole
    chosen = index[at >= begin - 1e-6]
    needed = int(np.searchsorted(at[chosen], end - 1e-6)) + 1
    return np.asarray(tour[chosen[: max(needed, 2)] % stops])


def _path(roads: RoadMap, stops: IntArray, rng: np.random.Generator) -> FloatArray:
    """Return the points (P, 2) of one robot's path along its stops."""
    nodes = roads.nearest(roads.points[stops] + rng.uniform(-0.6, 0.6, (len(stops), 2)))
    legs = [roads.path(int(start), int(end)) for start, end in pairwise(nodes)]
    return np.vstack([legs[0][:1], *(leg[1:] for leg in legs)])


def _smoothed(path: FloatArray, clearance_map: ClearanceMap) -> FloatArray:
    """Return the path with rounded corners where walls allow it."""
    for _ in range(60):
        middle = path.copy()
        middle[1:-1] = (path[:-2] + 2.0 * path[1:-1] + path[2:]) / 4.0
        path = np.where((clearance_map.at(middle) >= PLANNED_CLEARANCE - 0.03)[:, None], middle, path)
    return path


def _check(robots: int, length: float | None, duration: float | None, overlap: float, speed: float) -> None:
    if not 1 <= robots <= _MOST_ROBOTS:
        raise ValueError(f"robots must be at least 1 and at most {_MOST_ROBOTS}, got {robots}")
    if not 0.0 <= overlap <= 0.9:
        raise ValueError(f"overlap must be within 0 to 0.9, got {overlap}")
    for name, value in (("length", length), ("duration", duration), ("speed", speed)):
        if value is not None and not 0.0 < value < math.inf:
            raise ValueError(f"{name} must be positive, got {value}")
