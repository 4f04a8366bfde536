"""What it takes to merge the sessions of many robots in many buildings, and whether each building becomes one map."""

import argparse
import dataclasses
import itertools
import json
import resource
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datasets.synthetic.map_pairs.pairs import PlacedMap, maps_of
from merging import MergeConfig, merge
from merging.fusion.fusion import fuse
from merging.fusion.warping import place
from merging.map_graph.grouping import Group, groups_of
from tbmslam.io.atomic_file import write_bytes, write_text
from tbmslam.io.pictures import encode_png
from tbmslam.map.tbm_map import TbmMap
from tools.benchmarks.fleet_picture import draw_fleet
from tools.benchmarks.measured_process import forget_peak_memory, in_fresh_process, peak_memory_mb
from tools.benchmarks.placed_maps import is_right, joined_pairs, known_pair, maps_by_name, shuffled
from tools.benchmarks.result_table import ResultTable, write_tables
from tools.benchmarks.strangers import building_of
from tools.command_line.text_table import describe_machine, machine_line, number, text_table

HEAD = (
    *("buildings", "maps", "pairs", "aligned", "groups", "joined rightly %", "joined wrongly", "placed %"),
    *("CPU s", "wall s", "peak MB"),
)
NOTES = """\
Simulated maps of buildings, all merged at once. groups: those of two maps or more. joined: pairs of maps in one group,
rightly where that puts the second within 0.5 m and 4 degrees of its true place. placed: maps in the largest group of
their building. CPU s: of all processes of this machine; peak MB: of the merging process."""

_SEEDS_APART = 100_000
"""Numbers of buildings between those of one seed and those of the next."""


@dataclass(frozen=True)
class FleetRun:
    """Figures of one fleet.

    Parameters
    ----------
    buildings, maps
        How many there were.
    aligned
        Pairs of maps that were aligned.
    groups
        Groups of two maps or more.
    right, possible
        Pairs of maps of one building that were joined rightly, and all of them.
    wrong
        Pairs of maps that were joined wrongly.
    placed
        Maps in the largest group of their building.
    cpu_s, wall_s
        Time that the merge took.
    peak_memory_mb
        Most memory that a process held.
    """

    buildings: int
    maps: int
    aligned: int
    groups: int
    right: int
    possible: int
    wrong: int
    placed: int
    cpu_s: float
    wall_s: float
    peak_memory_mb: float


def benchmark_fleet(args: argparse.Namespace) -> None:
    """Merge fleets of the given sizes and print what became of them."""
    machine = describe_machine()
    plots = [args.plot, *[None] * len(args.sizes)]
    runs = [
        in_fresh_process(run_fleet, size[0], size[1], args.seed, args.workers, args.scheduler, plot)
        for size, plot in zip(args.sizes, plots, strict=False)
    ]
    table = ResultTable(HEAD, [_row(run) for run in runs])
    print(text_table(*table))
    print(NOTES)
    print(machine_line(machine))
    if args.json:
        write_text(args.json, json.dumps({"machine": machine, "fleets": [dataclasses.asdict(run) for run in runs]}))
    write_tables(args.table, machine, {"fleets": table})


def run_fleet(
    buildings: int, maps_each: int, seed: int, workers: int, scheduler: str | None, plot: Path | None = None
) -> FleetRun:
    """Make a fleet and merge it, and draw it where a picture is wanted; the same numbers make the same fleet."""
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
        # Where maps without drives differ by a cell, the default rule leaves nothing to be seen.
        mean = fuse(layers, "average").grid
        write_bytes(plot, encode_png(draw_fleet(every, accepted, list(found.alignments), mean)))
    right, wrong = _joined(groups, placed, maps)
    return FleetRun(
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
    """Return so many maps of each of some buildings, in any order; the same numbers make the same maps."""
    rng = np.random.default_rng([seed, buildings, maps_each])
    placed = [
        dataclasses.replace(one, place=f"building {index}")
        for index in range(buildings)
        for one in maps_of(building_of(seed * _SEEDS_APART + index, rng), maps_each, rng)
    ]
    return shuffled(placed, rng)


def _joined(groups: list[Group], placed: Mapping[str, PlacedMap], maps: Mapping[str, TbmMap]) -> tuple[int, int]:
    """Return how many pairs of maps were joined rightly, and how many wrongly."""
    joined = joined_pairs(groups)
    right = sum(is_right(known_pair(pair, placed, maps), where) for pair, where in joined.items())
    return right, len(joined) - right


def _placed(groups: list[Group], placed: Mapping[str, PlacedMap]) -> int:
    largest = Counter[str]()
    for group in groups:
        for building, count in Counter(placed[name].place for name in group.poses).items():
            largest[building] = max(largest[building], count)
    return largest.total()


def _cpu_s() -> float:
    """Return the CPU time of this process and of those that it has waited for."""
    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(use.ru_utime + use.ru_stime for use in uses)


def _row(run: FleetRun) -> list[str]:
    return [
        str(run.buildings),
        str(run.maps),
        str(run.maps * (run.maps - 1) // 2),
        str(run.aligned),
        str(run.groups),
        number(100.0 * run.right / run.possible, 1) if run.possible else "-",
        str(run.wrong),
        number(100.0 * run.placed / run.maps, 1) if run.possible else "-",
        number(run.cpu_s, 0),
        number(run.wall_s, 0),
        number(run.peak_memory_mb, 0),
    ]
