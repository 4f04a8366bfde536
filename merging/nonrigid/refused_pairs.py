"""Maps that no alignment joined: each two get another look, one of them bent."""

import itertools
import logging
from collections.abc import Mapping, Sequence
from functools import partial

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.merge_state import MergeState
from merging.nonrigid.search import NonrigidRegistration, register_nonrigid
from merging.pairwise.cluster import Packed, pack, unpack
from merging.pairwise.executor import Executor
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.cluster import Cluster
from tbmslam.parallel.progress import Watch
from tbmslam.parallel.worker_pool import worker_pool

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
    grids = {name: TbmMap(found.maps[name].grid) for name in dict.fromkeys(itertools.chain.from_iterable(pairs))}
    workers, watch = min(executor.workers, len(pairs)), executor.watch
    if executor.scheduler is not None:
        looks = _on_cluster(pairs, grids, config, executor.scheduler, watch)
    elif workers <= 1:
        looks = [_look(pair, grids, config) for pair in watch.each(pairs, "bending", len(pairs), "pairs")]
    else:
        with worker_pool(workers, partial(_hire, grids, config)) as pool:
            looks = list(watch.each(pool.map(_look_here, pairs), "bending", len(pairs), "pairs"))
    joins = {pair: look for pair, look in zip(pairs, looks, strict=True) if look is not None}
    for (target, source), look in joins.items():
        logger.info("%s in %s: accepted: %s", source, target, look.alignment.reason)
    return joins


_here: list[tuple[Mapping[str, TbmMap], MergeConfig]] = []
"""The maps, where this process is a worker, and how it bends them."""


def _hire(grids: Mapping[str, TbmMap], config: MergeConfig) -> None:
    _here[:] = [(grids, config)]


def _look_here(pair: Pair) -> NonrigidRegistration | None:
    return _look(pair, *_here[0])


def _look(pair: Pair, grids: Mapping[str, TbmMap], config: MergeConfig) -> NonrigidRegistration | None:
    return register_nonrigid(grids[pair[0]], grids[pair[1]], config)


def _on_cluster(
    pairs: Sequence[Pair], grids: Mapping[str, TbmMap], config: MergeConfig, scheduler: str, watch: Watch
) -> list[NonrigidRegistration | None]:
    with Cluster(scheduler) as cluster:
        there = {name: cluster.submit(f"map {name}", _map_of, pack(one.grid)) for name, one in grids.items()}
        submitted = [
            cluster.submit(f"{source} bent in {target}", register_nonrigid, there[target], there[source], config)
            for target, source in pairs
        ]
        return list(watch.each(cluster.results(submitted), "bending", len(pairs), "pairs"))


def _map_of(packed: Packed) -> TbmMap:
    return TbmMap(unpack(packed))
