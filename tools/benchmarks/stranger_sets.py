"""The rate of false joins in sets of maps.

The wrong poses of three maps may be consistent by chance, and maps of one place are similar to the same other place.
Therefore a set may be joined wrongly although every pair is refused.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest
from tqdm import tqdm

from datasets.synthetic.map_pairs.pairs import Building, PlacedMap, maps_of, maps_of_far_ends, maps_of_mirrored
from merging import MergeConfig, merge
from merging.alignment import Pair
from merging.map_graph.grouping import groups_of
from tbmslam.parallel.worker_pool import worker_pool
from tools.benchmarks.strangers import building_of, some_part
from tools.command_line.text_table import ResultTable, describe_machine, machine_line, number, text_table, write_tables
from tools.map_pairs import is_right, joined_pairs, known_pair, maps_by_name, shuffled

MAPS = 6
"""Number of maps of a set."""
KINDS = {
    "six buildings": "a map of each",
    "two buildings": "three maps of each",
    "mirrored": "three maps of a building, three of its mirror image",
    "far ends": "three maps of each of two ends of a building that share nothing",
}
HEAD = (
    "sets",
    "maps",
    "tried",
    "pairs accepted wrongly",
    "sets joined wrongly",
    "rate %",
    "95 % interval",
    "joined rightly",
)

_SETS_APART, _SEEDS_APART = 100, 100_000
"""Differences between the building numbers of consecutive sets, and of consecutive seeds."""


@dataclass(frozen=True)
class StrangerSet:
    """The merge of one set."""

    kind: str
    """One of `KINDS`."""
    number: int
    """Number of the set."""
    accepted: tuple[Pair, ...]
    """Pairs that were accepted wrongly."""
    joined: tuple[Pair, ...]
    """Pairs that were joined wrongly."""
    right: int
    possible: int
    """Numbers of pairs that were joined correctly, and of pairs that show one place."""


def benchmark_sets(args: argparse.Namespace) -> None:
    """Merge sets and print the rate of false joins."""
    machine = describe_machine()
    met = list(tqdm(_meet_all(args.sets, args.seed, args.workers), total=args.sets, disable=None))
    table = summary(met)
    print(text_table(*table))
    for outcome in met:
        if outcome.joined:
            how = "an accepted pair" if set(outcome.accepted) & set(outcome.joined) else "refused pairs that agree"
            names = sorted(set(itertools.chain.from_iterable(outcome.joined)))
            print(f"wrongly joined: {', '.join(names)} of set {outcome.number}, {outcome.kind}, by {how}")
    print(machine_line(machine))
    write_tables(args.table, machine, {"sets": table})


def summary(met: list[StrangerSet]) -> ResultTable:
    """Return the table."""
    rows = [_row(kind, about, [outcome for outcome in met if outcome.kind == kind]) for kind, about in KINDS.items()]
    return ResultTable(HEAD, [*rows, _row("all", "", met)])


def meet_set(number_of_set: int, seed: int) -> StrangerSet:
    """Make a set by its number and merge it."""
    placed = make_set(number_of_set, seed)
    maps = maps_by_name(placed)
    config = MergeConfig()
    found = merge(maps, config).alignments
    pairs = {pair: known_pair(pair, placed, maps) for pair in itertools.combinations(maps, 2)}
    joined = joined_pairs(groups_of(list(maps), found, config.graph))
    right = [pair for pair, where in joined.items() if is_right(pairs[pair], where)]
    return StrangerSet(
        kind_of(number_of_set),
        number_of_set,
        tuple(
            pair
            for pair, outcome in found.items()
            if outcome.accepted and not is_right(pairs[pair], outcome.T_target_source)
        ),
        tuple(pair for pair in joined if pair not in right),
        len(right),
        sum(known.T_target_source is not None for known in pairs.values()),
    )


def kind_of(number_of_set: int) -> str:
    """Return the kind of a set."""
    return list(KINDS)[number_of_set % len(KINDS)]


def make_set(number_of_set: int, seed: int) -> dict[str, PlacedMap]:
    """Return the maps of a set, each of a whole building or of a part of one."""
    rng = np.random.default_rng([seed, number_of_set, MAPS])
    first = seed * _SEEDS_APART + number_of_set * _SETS_APART
    kind, half = kind_of(number_of_set), MAPS // 2
    if kind == "six buildings":
        placed = [outcome for index in range(MAPS) for outcome in maps_of(_building(first + index, rng), 1, rng)]
    elif kind == "two buildings":
        placed = [outcome for index in range(2) for outcome in maps_of(_building(first + index, rng), half, rng)]
    else:
        both = maps_of_mirrored if kind == "mirrored" else maps_of_far_ends
        placed = list(both(_building(first, rng), half, rng))
    return shuffled(placed, rng)


def _building(number_of_building: int, rng: np.random.Generator) -> Building:
    return some_part(building_of(number_of_building, rng), rng)


def _row(kind: str, about: str, met: list[StrangerSet]) -> list[str]:
    tried, wrong = len(met), sum(bool(outcome.joined) for outcome in met)
    if not tried:
        return [kind, about, "0", "0", "0", "-", "-", "-"]
    interval = binomtest(wrong, tried).proportion_ci(0.95)  # Clopper and Pearson 1934
    bounds = f"{100.0 * interval.low:.2f} to {100.0 * interval.high:.2f}"
    accepted = sum(len(outcome.accepted) for outcome in met)
    right, possible = sum(outcome.right for outcome in met), sum(outcome.possible for outcome in met)
    rightly = f"{right} of {possible}" if possible else "-"
    return [kind, about, str(tried), str(accepted), str(wrong), number(100.0 * wrong / tried, 2), bounds, rightly]


def _meet_all(count: int, seed: int, workers: int) -> Iterator[StrangerSet]:
    if workers == 1:
        yield from (meet_set(index, seed) for index in range(count))
        return
    with worker_pool(workers) as pool:
        yield from pool.map(meet_set, range(count), [seed] * count)
