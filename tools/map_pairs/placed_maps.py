"""Sets of maps with known places: the input of a merge, and its groups compared with the truth."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from datasets.synthetic.map_pairs.pairs import PlacedMap
from merging.alignment import Pair
from merging.map_graph.grouping import Group
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tools.map_pairs.known_pair import KnownPair


def shuffled(placed: Sequence[PlacedMap], rng: np.random.Generator) -> dict[str, PlacedMap]:
    """Return maps in random order by names without their places."""
    return {f"map_{index}": placed[chosen] for index, chosen in enumerate(rng.permutation(len(placed)).tolist())}


def maps_by_name(placed: Mapping[str, PlacedMap]) -> dict[str, TbmMap]:
    """Return the maps by name."""
    return {name: TbmMap.from_occupancy(one.occupancy, one.resolution) for name, one in placed.items()}


def known_pair(pair: Pair, placed: Mapping[str, PlacedMap], maps: Mapping[str, TbmMap]) -> KnownPair:
    """Return a pair of maps with its true pose."""
    target, source = (placed[name] for name in pair)
    motion = target.T_map_building @ source.T_map_building.inverse() if target.place == source.place else None
    return KnownPair("-".join(pair), maps[pair[0]], maps[pair[1]], motion, 0.0)


def joined_pairs(groups: Sequence[Group]) -> dict[Pair, SE2]:
    """Return the relative pose of every two maps of a group."""
    return {
        (a, b): group.poses[a].inverse() @ group.poses[b]
        for group in groups
        for a, b in itertools.combinations(sorted(group.poses), 2)
    }
