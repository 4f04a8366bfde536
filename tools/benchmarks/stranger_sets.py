"""How often sets of maps of as many buildings are joined, though no two of them belong together.

Of many maps three may lead to each other round a circle by chance; a set may be joined of which every pair is refused.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest
from tqdm import tqdm

from datasets.synthetic.map_pairs import foreign_pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import groups_of
from tbmslam.tbm_map import TbmMap
from tbmslam.worker_pool import worker_pool
from tools.benchmarks.strangers import building_of, some_part
from tools.machine import describe_machine, machine_line
from tools.pair_files import KnownPair
from tools.text_table import number, text_table

MAPS = 6
"""Maps of a set."""
HEAD = ("sets", "maps of each", "pairs", "pairs accepted", "sets with maps joined", "rate %", "95 % interval")

_SETS_APART, _SEEDS_APART = 100, 100_000
"""Numbers of buildings between those of one set and those of the next, and between those of seeds."""


@dataclass(frozen=True)
class StrangerSet:
    """What became of one set.

    Parameters
    ----------
    number
        Of the set.
    accepted
        Pairs that were accepted.
    joined
        The maps of every group of more than one.
    """

    number: int
    accepted: tuple[tuple[str, str], ...]
    joined: tuple[tuple[str, ...], ...]


def benchmark_sets(args: argparse.Namespace) -> None:
    """Try as many sets as asked for and print the rate."""
    machine = describe_machine()
    met = list(tqdm(_meet_all(args.sets, args.seed, args.workers), total=args.sets, disable=None))
    print(summary(met))
    for one in met:
        for names in one.joined:
            is_accepted = any(set(pair) <= set(names) for pair in one.accepted)
            how = "an accepted pair" if is_accepted else "refused pairs that lead to each other"
            print(f"wrongly joined: {', '.join(names)} of set {one.number}, by {how}")
    print(machine_line(machine))


def summary(met: list[StrangerSet]) -> str:
    """Return the table."""
    wrong, pairs = sum(bool(one.joined) for one in met), len(met) * MAPS * (MAPS - 1) // 2
    interval = binomtest(wrong, len(met)).proportion_ci(0.95)  # Clopper and Pearson 1934
    rate, bounds = number(100.0 * wrong / len(met), 2), f"{100.0 * interval.low:.2f} to {100.0 * interval.high:.2f}"
    accepted = sum(len(one.accepted) for one in met)
    return text_table(HEAD, [[str(len(met)), str(MAPS), str(pairs), str(accepted), str(wrong), rate, bounds]])


def meet_set(number_of_set: int, seed: int) -> StrangerSet:
    """Make a set and join its maps; the same numbers make the same set."""
    config = MergeConfig()
    found = align_all(make_set(number_of_set, seed), config)
    groups = groups_of([f"map_{index}" for index in range(MAPS)], found, config.graph)
    return StrangerSet(
        number_of_set,
        tuple(pair for pair, one in found.items() if one.accepted),
        tuple(tuple(group.poses) for group in groups if len(group) > 1),
    )


def make_set(number_of_set: int, seed: int) -> dict[str, TbmMap]:
    """Return maps of as many buildings, of the whole or of a part; the same numbers make the same maps."""
    rng = np.random.default_rng([seed, number_of_set, MAPS])
    first = seed * _SEEDS_APART + number_of_set * _SETS_APART
    buildings = [some_part(building_of(first + index, rng), rng) for index in range(MAPS)]
    two_and_two = zip(buildings[::2], buildings[1::2], strict=True)
    pairs = [KnownPair.of(foreign_pair(*both, int(rng.integers(2**31)))) for both in two_and_two]
    maps = itertools.chain.from_iterable((pair.target, pair.source) for pair in pairs)
    return {f"map_{index}": one for index, one in enumerate(maps)}


def _meet_all(count: int, seed: int, workers: int) -> Iterator[StrangerSet]:
    if workers == 1:
        yield from (meet_set(index, seed) for index in range(count))
        return
    with worker_pool(workers) as pool:
        yield from pool.map(meet_set, range(count), [seed] * count)
