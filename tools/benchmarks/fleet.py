"""Cost and errors of a merge of many maps of many buildings, with a picture of the groups."""

import argparse
import dataclasses
import itertools
import math
import os
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from datasets.synthetic.map_pairs.pairs import PlacedMap, maps_of
from merging import MergeConfig, merge
from merging.alignment import Pair
from merging.fusion import fuse, place
from merging.map_graph.grouping import Group, groups_of
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.io.atomic_file import write_bytes
from tbmslam.io.pictures import Picture, encode_png
from tbmslam.map.tbm_map import TbmMap
from tools.benchmarks.measured_process import forget_peak_memory, in_fresh_process, peak_memory_mb
from tools.benchmarks.strangers import building_of
from tools.command_line.measurement_record import finish
from tools.command_line.text_table import ResultTable, number, text_table
from tools.map_pairs.placed_maps import joined_pairs, known_pair, maps_by_name, shuffled

NOTES = """\
Simulated maps of buildings, all merged at once. groups: groups of two maps or more. joined: pairs of maps in one group;
a pair is right if the pose of the second map is within 0.5 m and 4 degrees of the truth. placed: maps in the largest
group of their building. CPU s: of all processes of this machine; peak MB: of the merging process."""

_SEEDS_APART = 100_000  # difference between the building numbers of consecutive seeds


@dataclass(frozen=True)
class FleetRun:
    """Figures of one fleet."""

    seed: int
    buildings: int
    maps: int
    aligned: int
    """Number of pairs that were aligned."""
    groups: int
    """Number of groups of two maps or more."""
    right: int
    possible: int
    """Number of pairs of one building that were joined correctly, and number of all pairs of one building."""
    wrong: int
    """Number of pairs that were joined wrongly."""
    placed: int
    """Number of maps in the largest group of their building."""
    cpu_s: float
    wall_s: float
    """CPU time and wall time of the merge [s]."""
    peak_memory_mb: float


def benchmark_fleet(args: argparse.Namespace) -> None:
    """Merge fleets of the given sizes and print the table."""
    plots = itertools.chain([args.plot], itertools.repeat(None))
    runs = [
        in_fresh_process(run_fleet, buildings, maps_each, seed, args.workers, args.scheduler, next(plots))
        for buildings, maps_each in args.sizes
        for seed in args.seeds
    ]
    table = ResultTable.of([_row(run) for run in runs])
    print(text_table(*table))
    print(NOTES)
    finish(args, {"fleets": table}, {"fleets": runs})


def run_fleet(
    buildings: int, maps_each: int, seed: int, workers: int, scheduler: str | None, plot: Path | None = None
) -> FleetRun:
    """Make a fleet by its numbers, merge it, and draw it to `plot` if that is given."""
    placed = make_fleet(buildings, maps_each, seed)
    maps = maps_by_name(placed)
    forget_peak_memory()  # of the simulation
    config, begin, cpu = MergeConfig(), time.perf_counter(), _cpu_s()
    found = merge(maps, config, workers, scheduler=scheduler)
    wall_s, cpu_s = time.perf_counter() - begin, _cpu_s() - cpu
    every = groups_of(list(maps), found.alignments, config.graph)
    groups, peak_mb = [group for group in every if len(group) > 1], peak_memory_mb()
    if plot is not None and found.merged is not None:
        accepted = [pair for pair, one in found.alignments.items() if one.accepted]
        layers = [place(maps[name].grid, pose, found.merged.grid.geometry) for name, pose in found.poses.items()]
        # Under the default rule, walls of maps without drives vanish if they differ by a cell.
        mean = fuse(layers, "average").grid
        write_bytes(plot, encode_png(draw_fleet(every, accepted, list(found.alignments), mean)))
    right, wrong = _joined(groups, placed, maps)
    return FleetRun(
        seed,
        buildings,
        len(maps),
        len(found.alignments),
        len(groups),
        right,
        sum(one.place == other.place for one, other in itertools.combinations(placed.values(), 2)),
        wrong,
        _placed(groups, placed),
        cpu_s,
        wall_s,
        peak_mb,
    )


def make_fleet(buildings: int, maps_each: int, seed: int) -> dict[str, PlacedMap]:
    """Return `maps_each` maps of each building in random order, by name."""
    rng = np.random.default_rng([seed, buildings, maps_each])
    placed = [
        dataclasses.replace(one, place=f"building {index}")
        for index in range(buildings)
        for one in maps_of(building_of(seed * _SEEDS_APART + index, rng), maps_each, rng)
    ]
    return shuffled(placed, rng)


def _joined(groups: list[Group], placed: Mapping[str, PlacedMap], maps: Mapping[str, TbmMap]) -> tuple[int, int]:
    """Return the numbers of pairs that were joined correctly, and wrongly."""
    joined = joined_pairs(groups)
    right = sum(known_pair(pair, placed, maps).is_near(where) for pair, where in joined.items())
    return right, len(joined) - right


def _placed(groups: list[Group], placed: Mapping[str, PlacedMap]) -> int:
    largest = Counter[str]()
    for group in groups:
        for building, count in Counter(placed[name].place for name in group.poses).items():
            largest[building] = max(largest[building], count)
    return largest.total()


def _cpu_s() -> float:
    """Return the CPU time of this process and its finished children [s]."""
    return sum(os.times()[:4])


def _row(run: FleetRun) -> dict[str, str]:
    return {
        "seed": str(run.seed),
        "buildings": str(run.buildings),
        "maps": str(run.maps),
        "pairs": str(run.maps * (run.maps - 1) // 2),
        "aligned": str(run.aligned),
        "groups": str(run.groups),
        "joined rightly %": number(100.0 * run.right / run.possible, 1) if run.possible else "-",
        "joined wrongly": str(run.wrong),
        "placed %": number(100.0 * run.placed / run.maps, 1) if run.possible else "-",
        "CPU s": number(run.cpu_s, 0),
        "wall s": number(run.wall_s, 0),
        "peak MB": number(run.peak_memory_mb, 0),
    }


_FINER = 2  # factor of oversampling
_HEIGHT, _MARGIN = 672, 24  # height of both pictures, and the margin around them [pixels]
_RING, _NODE = 0.32, 0.045
"""Radius of the ring of a group's maps, and of a map's dot, in sides of the group's square."""
_SURE = (0.3, 0.7)  # probabilities of occupied that are drawn white and black
_WHITE, _FAINT, _ALONE, _UNSEEN = (255, 255, 255), (232, 232, 232), (150, 150, 150), 226
_COLOURS = (
    (178, 114, 0),
    (0, 94, 213),
    (115, 158, 0),
    (167, 121, 204),
    (0, 159, 230),
    (233, 180, 86),
    (61, 61, 158),
    (128, 128, 0),
)
"""Colours of groups as blue, green, red; after M. Okabe and K. Ito, "Color universal design", 2008."""


def draw_fleet(
    groups: Sequence[Group], accepted: Collection[Pair], aligned: Collection[Pair], merged: TbmGrid
) -> Picture:
    """Draw maps as dots, with a ring for each group, and alignments as lines; beside them a merged map.

    The largest group comes first; single maps are grey. Accepted pairs have their group's colour, refused pairs are
    faint.
    """
    graph, grid = _graph(groups, set(accepted), aligned), _map(merged)
    return np.hstack([_framed(graph), _framed(grid)])


def _framed(picture: Picture) -> Picture:
    """Return a picture with a margin."""
    framed = cv2.copyMakeBorder(picture, _MARGIN, _MARGIN, _MARGIN, _MARGIN, cv2.BORDER_CONSTANT, value=_WHITE)
    return np.asarray(framed, dtype=np.uint8)


def _graph(groups: Sequence[Group], accepted: set[Pair], aligned: Collection[Pair]) -> Picture:
    across = max(math.ceil(math.sqrt(len(groups))), 1)
    down = max(math.ceil(len(groups) / across), 1)
    side = _HEIGHT / down
    picture = np.full((_HEIGHT * _FINER, round(across * side) * _FINER, 3), 255, dtype=np.uint8)
    places, colours = dict[str, FloatArray](), dict[str, tuple[int, int, int]]()
    for index, group in enumerate(groups):
        middle = (np.array([index % across, index // across]) + 0.5) * side
        colour = _COLOURS[index % len(_COLOURS)] if len(group) > 1 else _ALONE
        for name, spot in zip(group.poses, _ring(middle, side * _RING, len(group)), strict=True):
            places[name], colours[name] = spot, colour
    for pair in aligned:
        if pair not in accepted:
            _line(picture, places, pair, _FAINT, 1)
    for pair in aligned:
        if pair in accepted:
            _line(picture, places, pair, colours[pair[0]], 2)
    for name, spot in places.items():
        for radius, colour in ((1.25 * _NODE, _WHITE), (_NODE, colours[name])):
            cv2.circle(picture, _pixel(spot), round(radius * side * _FINER), colour, -1, cv2.LINE_AA)
    return np.asarray(cv2.resize(picture, None, fx=1 / _FINER, fy=1 / _FINER, interpolation=cv2.INTER_AREA), np.uint8)


def _ring(middle: FloatArray, radius: float, count: int) -> Iterator[FloatArray]:
    """Yield the positions of `count` maps on a ring, the first one above the middle."""
    for turn in np.arange(count) * (2.0 * math.pi / count):
        yield middle + (radius if count > 1 else 0.0) * np.array([math.sin(turn), -math.cos(turn)])


def _line(
    picture: Picture, places: Mapping[str, FloatArray], pair: Pair, colour: tuple[int, int, int], width: int
) -> None:
    cv2.line(picture, _pixel(places[pair[0]]), _pixel(places[pair[1]]), colour, width * _FINER, cv2.LINE_AA)


def _pixel(place: FloatArray) -> tuple[int, int]:
    return round(float(place[0]) * _FINER), round(float(place[1]) * _FINER)


def _map(grid: TbmGrid) -> Picture:
    """Return a picture of a map: walls are dark, free space is white, unknown cells are grey."""
    known = grid.cropped_to_known(margin=8)
    free = np.clip((_SURE[1] - known.pignistic()) / (_SURE[1] - _SURE[0]), 0.0, 1.0)
    shades = np.where(known.is_known(), 255.0 * free, _UNSEEN).astype(np.uint8)[::-1]
    size = max(round(shades.shape[1] * _HEIGHT / shades.shape[0]), 1), _HEIGHT
    smaller = cv2.resize(np.ascontiguousarray(shades), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(smaller, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
