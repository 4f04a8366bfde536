"""Cost and errors of a merge of many maps of many buildings, with a picture of the groups."""

import argparse
import dataclasses
import io
import itertools
import math
import os
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datasets.synthetic.map_pairs.pairs import PlacedMap, maps_of
from merging import MergeConfig, merge
from merging.alignment import Pair
from merging.fusion import fuse, place
from merging.map_graph.grouping import Group, groups_of
from tbmslam.belief.grid import TbmGrid
from tbmslam.io.atomic_file import write_bytes
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
        write_bytes(plot, draw_fleet(every, accepted, list(found.alignments), mean))
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


_RING = 0.32  # radius of the ring of a group's maps, in sides of the group's square
_SURE = (0.3, 0.7)  # probabilities of occupied that are drawn white and black
_UNSEEN = 0.345  # the probability whose grey is that of unknown cells
_FAINT, _ALONE = "#E8E8E8", "#969696"
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#9E3D3D", "#008080")
"""Colours of groups, after M. Okabe and K. Ito, "Color universal design", 2008."""


def draw_fleet(
    groups: Sequence[Group], accepted: Collection[Pair], aligned: Collection[Pair], merged: TbmGrid
) -> bytes:
    """Draw maps as dots, with a ring for each group, and alignments as lines; beside them a merged map.

    The largest group comes first; single maps are grey. Accepted pairs have their group's colour, refused pairs are
    faint. Returns a PNG.
    """
    from matplotlib.figure import Figure  # an extra, and slow to load

    figure, across = Figure((14.4, 7.2), layout="constrained"), max(math.ceil(math.sqrt(len(groups))), 1)
    graph, picture = figure.subplots(1, 2)
    places, colours = dict[str, tuple[float, float]](), dict[str, str]()
    for index, group in enumerate(groups):
        radius, colour = (_RING, _COLOURS[index % len(_COLOURS)]) if len(group) > 1 else (0.0, _ALONE)
        for number_of_map, name in enumerate(group.poses):
            turn = number_of_map * 2.0 * math.pi / len(group)
            places[name] = index % across + radius * math.sin(turn), radius * math.cos(turn) - index // across
            colours[name] = colour
    for pair in sorted(aligned, key=set(accepted).__contains__):  # refused pairs lie below
        line, colour = [places[name] for name in pair], colours[pair[0]] if pair in accepted else _FAINT
        graph.plot(*zip(*line, strict=True), color=colour, linewidth=2.0 if pair in accepted else 1.0, zorder=1)
    graph.scatter(
        *zip(*places.values(), strict=True), 3e3 / across**2, [*colours.values()], edgecolors="white", zorder=2
    )
    known = merged.cropped_to_known(margin=8)
    shades = np.where(known.is_known(), known.pignistic(), _UNSEEN)
    picture.imshow(shades, "gray_r", vmin=_SURE[0], vmax=_SURE[1], origin="lower")
    for axes in (graph, picture):
        axes.set_aspect("equal")
        axes.axis("off")
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100)
    return buffer.getvalue()
