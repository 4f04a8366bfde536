"""Maps that no alignment joined: each two get another look, one of them bent."""

import itertools
import logging

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.merge_state import MergeState
from merging.nonrigid.search import NonrigidRegistration, register_nonrigid
from merging.pairwise.compressed_grid import CompressedGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


def register_refused_pairs(
    found: MergeState,
    config: MergeConfig,
    executor: Executor,
) -> dict[Pair, NonrigidRegistration]:
    """Look at refused pairs of different groups, one of each two maps bent; return those that were aligned so.

    Parameters
    ----------
    found
        The maps, and what is known of them so far.
    config
        How maps are bent and believed.
    executor
        Who bends them.
    """
    pairs = [pair for pair in found.apart() if not found.alignments[pair].accepted]
    if not (pairs and config.nonrigid.enabled and config.method == "correlation"):
        return {}
    maps = {
        name: Call(f"map {name}", _map_of, (CompressedGrid(found.maps[name].grid),))
        for name in dict.fromkeys(itertools.chain.from_iterable(pairs))
    }
    calls = [
        Call(f"{source} bent in {target}", register_nonrigid, (maps[target], maps[source], config))
        for target, source in pairs
    ]
    looks: list[NonrigidRegistration | None] = executor.results(calls, "bending", "pairs")
    joins = {pair: look for pair, look in zip(pairs, looks, strict=True) if look is not None}
    for (target, source), look in joins.items():
        logger.info("%s in %s: accepted: %s", source, target, look.alignment.reason)
    return joins


def _map_of(sent: CompressedGrid) -> TbmMap:
    return TbmMap(sent.grid)
