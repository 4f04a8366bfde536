"""Every pair of some maps aligned, in several processes where that is wanted."""

import itertools
import logging
from collections.abc import Mapping, Sequence
from functools import partial

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.pairwise.cluster import align_on_cluster
from merging.pairwise.executor import Executor
from merging.pairwise.prepared_maps import PreparedMaps
from merging.rigid_alignment import align_prepared
from tbmslam.belief.grid import TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.worker_pool import worker_pool

logger = logging.getLogger(__name__)


def align_all(
    maps: Mapping[str, TbmMap],
    config: MergeConfig,
    executor: Executor | None = None,
    pairs: Sequence[Pair] | None = None,
) -> dict[Pair, Alignment]:
    """Align every pair of maps, or some pairs; the one named first is the target.

    Parameters
    ----------
    maps
        Maps by name.
    config
        How they are aligned.
    executor
        Who aligns them; this process where None.
    pairs
        The pairs wanted; every one where None.

    Raises
    ------
    ClusterError
        If the cluster cannot be reached or gives up.
    WorkerDiedError
        If a process of this machine died.
    """
    executor = executor or Executor()
    watch = executor.watch
    grids = {name: one.grid for name, one in maps.items()}
    pairs = list(itertools.combinations(maps, 2)) if pairs is None else pairs
    workers = min(executor.workers, len(pairs))
    if executor.scheduler is not None:
        found = align_on_cluster(pairs, grids, config, executor.scheduler, watch)
    elif workers <= 1:
        views = PreparedMaps(grids, config)
        found = [
            align_prepared(*views.of_pair(pair), config) for pair in watch.each(pairs, "aligning", len(pairs), "pairs")
        ]
    else:
        with worker_pool(workers, partial(_hire, grids, config)) as pool:
            found = list(watch.each(pool.map(_align, pairs), "aligning", len(pairs), "pairs"))
    for (target, source), one in zip(pairs, found, strict=True):
        logger.info("%s in %s: %s: %s", source, target, "accepted" if one.accepted else "refused", one.reason)
    return dict(zip(pairs, found, strict=True))


_here: list[tuple[PreparedMaps, MergeConfig]] = []
"""What this process has seen, where it is a worker, and how it aligns."""


def _hire(grids: Mapping[str, TbmGrid], config: MergeConfig) -> None:
    _here[:] = [(PreparedMaps(grids, config), config)]


def _align(pair: Pair) -> Alignment:
    views, config = _here[0]
    return align_prepared(*views.of_pair(pair), config)
