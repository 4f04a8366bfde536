"""Robots' ways through a world: tours of its places, shared out among robots, driven as a robot would."""

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from datasets.synthetic.robot.driving import drive_along
from datasets.synthetic.world.clearance import ClearanceMap, RoadMap
from datasets.synthetic.world.world import World
from tbmslam.geometry.se2 import FloatArray
from tbmslam.geometry.trajectory import Trajectory

START_STAMP = 1_300_000_000.0
"""When every simulated recording begins [s], in March 2011."""

PLANNED_CLEARANCE = 0.42
"""Planned ways keep so far off walls [m]; driving cuts a corner here and there."""

AVERAGE_SPEED = 0.67
"""Mean speed over a drive, of the largest: turns and doors cost time."""


_MOST_ROBOTS = 1000
"""All of them are simulated before the first is written."""

COST_PER_METRE = 1.2
"""What a metre driven costs in a road map, about."""


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
    """Let robots drive through a world.

    All places of the world are put in a short closed tour. Each robot drives a stretch of it, neighbours sharing the
    fraction `overlap` of theirs; every other robot drives the other way round, and each on lines of its own.

    Parameters
    ----------
    robots
        How many.
    length, duration
        Where a drive ends, after so many metres or seconds, whichever comes first. With neither the stretches
        together cover the tour: a single robot comes back to where it began.
    overlap
        Shared part of neighbouring stretches, in [0, 0.9].
    speed
        Largest speed [m/s].
    seed
        Draws where the tour begins and all whims.

    Returns
    -------
    drives
        True poses in the world's frame at 50 Hz from `START_STAMP` on; between samples the twist is constant.
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
    # What ends after a length or time needs a path that certainly is longer.
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


def short_tour(costs: FloatArray, start: int = 0) -> npt.NDArray[np.int64]:
    """Return an order (K,) of all places as a short closed tour: the nearest next, then improved by 2-opt.

    Parameters
    ----------
    costs
        Symmetric cost (K, K) of going from one place to another.
    start
        The place that comes first.
    """
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


def _stops(roads: RoadMap, places: FloatArray) -> npt.NDArray[np.int64]:
    """Return the nodes where robots call, near the places; those that have none near are left out."""
    nodes = roads.nearest(places)
    away = np.hypot(*(roads.points[nodes] - places).T)
    _, first = np.unique(nodes, return_index=True)
    return np.asarray(nodes[np.sort(first[away[first] < 1.5])])


def _stretch(
    tour: float, robots: int, length: float | None, duration: float | None, overlap: float, speed: float
) -> float:
    """Return how much of the tour one robot drives, as cost."""
    lengths = [] if length is None else [length * COST_PER_METRE]
    if duration is not None:
        lengths.append(duration * speed * AVERAGE_SPEED * COST_PER_METRE)
    if lengths:
        return min(lengths)
    return tour if robots == 1 else tour / (robots * (1.0 - overlap))


def _stops_between(tour: npt.NDArray[np.int64], around: FloatArray, begin: float, end: float) -> npt.NDArray[np.int64]:
    """Return the stops of the tour from `begin` to `end`, going around as often as needed, and at least two."""
    whole, stops = around[-1], len(tour)
    count = math.ceil((end - begin) / whole + 2) * stops
    index = np.arange(count)
    first_turn = math.floor(begin / whole)
    at = around[index % stops] + (first_turn + index // stops) * whole
    chosen = index[at >= begin - 1e-6]
    needed = int(np.searchsorted(at[chosen], end - 1e-6)) + 1
    return np.asarray(tour[chosen[: max(needed, 2)] % stops])


def _path(roads: RoadMap, stops: npt.NDArray[np.int64], rng: np.random.Generator) -> FloatArray:
    """Return the points (P, 2) of one robot's way from near one stop to near the next."""
    nodes = roads.nearest(roads.points[stops] + rng.uniform(-0.6, 0.6, (len(stops), 2)))
    ways = [roads.way(int(start), int(end)) for start, end in pairwise(nodes)]
    return np.vstack([ways[0][:1], *(way[1:] for way in ways)])


def _smoothed(path: FloatArray, clearance_map: ClearanceMap) -> FloatArray:
    """Return the way with its corners rounded, where walls allow it."""
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
