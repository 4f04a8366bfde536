"""The rate of false joins among simulated sets of six maps of different places.

The wrong poses of three maps may be consistent by chance, and maps of one place are similar to the same other place.
Therefore a set may be joined wrongly although every pair is refused.
"""

import argparse
import itertools
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from datasets.synthetic.map_pairs.pairs import Building, PlacedMap, maps_of, maps_of_far_ends, maps_of_mirrored
from merging import MergeConfig, merge
from merging.alignment import Pair
from merging.map_graph.grouping import groups_of
from tbmslam.parallel.executor import Executor
from tools.benchmarks.strangers import building_of, meetings, rate_of, some_part
from tools.command_line.measurement_record import finish
from tools.command_line.text_table import ResultTable, text_table
from tools.map_pairs.placed_maps import joined_pairs, known_pair, maps_by_name, shuffled

MAPS = 6
"""Number of maps of a set."""
SET_KINDS = {
    "six buildings": "a map of each",
    "two buildings": "three maps of each",
    "mirrored": "three maps of a building, three of its mirror image",
    "far ends": "three maps of each of two ends of a building that share nothing",
}
SET_HEAD = (
    *("sets", "maps", "tried", "pairs accepted wrongly", "sets joined wrongly", "rate %", "95 % interval"),
    "joined rightly",
)

_SETS_APART, _SEEDS_APART = 100, 100_000
"""Differences between the building numbers of consecutive sets, and of consecutive seeds."""


@dataclass(frozen=True)
class StrangerSet:
    """The merge of one set."""

    kind: str
    """One of `SET_KINDS`."""
    number: int
    accepted: tuple[Pair, ...]
    """Pairs that were accepted wrongly."""
    joined: tuple[Pair, ...]
    """Pairs that were joined wrongly."""
    right: int
    possible: int
    """Numbers of pairs that were joined correctly, and of pairs that show one place."""


def benchmark_sets(args: argparse.Namespace) -> None:
    """Merge sets and print the rate of false joins."""
    tasks = [(index, args.seed) for index in range(args.sets)]
    met = list(tqdm(meetings(meet_set, tasks, Executor(args.workers), 1), total=args.sets, disable=None))
    table = summary(met)
    print(text_table(*table))
    for outcome in met:
        if outcome.joined:
            how = "an accepted pair" if set(outcome.accepted) & set(outcome.joined) else "refused pairs that agree"
            names = sorted(set(itertools.chain.from_iterable(outcome.joined)))
            print(f"wrongly joined: {', '.join(names)} of set {outcome.number}, {outcome.kind}, by {how}")
    finish(args, {"sets": table}, {"seed": args.seed, "sets": met})


def summary(met: list[StrangerSet]) -> ResultTable:
    """Return the table."""
    rows = [
        _row(kind, about, [outcome for outcome in met if outcome.kind == kind]) for kind, about in SET_KINDS.items()
    ]
    return ResultTable(SET_HEAD, [*rows, _row("all", "", met)])


def meet_set(number_of_set: int, seed: int) -> StrangerSet:
    """Make a set by its number and merge it."""
    placed = make_set(number_of_set, seed)
    maps = maps_by_name(placed)
    config = MergeConfig()
    found = merge(maps, config).alignments
    pairs = {pair: known_pair(pair, placed, maps) for pair in itertools.combinations(maps, 2)}
    joined = joined_pairs(groups_of(list(maps), found, config.graph))
    right = [pair for pair, where in joined.items() if pairs[pair].is_near(where)]
    return StrangerSet(
        kind_of(number_of_set),
        number_of_set,
        tuple(
            pair
            for pair, outcome in found.items()
            if outcome.accepted and not pairs[pair].is_near(outcome.T_target_source)
        ),
        tuple(pair for pair in joined if pair not in right),
        len(right),
        sum(known.T_target_source is not None for known in pairs.values()),
    )


def kind_of(number_of_set: int) -> str:
    """Return the kind of a set."""
    return list(SET_KINDS)[number_of_set % len(SET_KINDS)]


def make_set(number_of_set: int, seed: int) -> dict[str, PlacedMap]:
    """Return the maps of a set, each of a whole building or of a part of one."""
    rng = np.random.default_rng([seed, number_of_set, MAPS])
    first = seed * _SEEDS_APART + number_of_set * _SETS_APART
    kind, half = kind_of(number_of_set), MAPS // 2
    if kind == "six buildings":
        placed = [outcome for index in range(MAPS) for outcome in maps_of(_part(first + index, rng), 1, rng)]
    elif kind == "two buildings":
        placed = [outcome for index in range(2) for outcome in maps_of(_part(first + index, rng), half, rng)]
    else:
        both = maps_of_mirrored if kind == "mirrored" else maps_of_far_ends
        placed = list(both(_part(first, rng), half, rng))
    return shuffled(placed, rng)


def _part(number_of_building: int, rng: np.random.Generator) -> Building:
    return some_part(building_of(number_of_building, rng), rng)


def _row(kind: str, about: str, met: list[StrangerSet]) -> list[str]:
    tried, wrong = len(met), sum(bool(outcome.joined) for outcome in met)
    if not tried:
        return [kind, about, "0", "0", "0", "-", "-", "-"]
    accepted = sum(len(outcome.accepted) for outcome in met)
    right, possible = sum(outcome.right for outcome in met), sum(outcome.possible for outcome in met)
    rightly = f"{right} of {possible}" if possible else "-"
    return [kind, about, str(tried), str(accepted), str(wrong), *rate_of(wrong, tried), rightly]
