"""Every pair of some maps aligned, in several processes where that is wanted."""

import itertools
import logging
from collections.abc import Mapping, Sequence
from functools import partial

from merging.aligner import View, align_views, comparison_resolution, view_of
from merging.alignment import Alignment
from merging.cluster_pairs import align_on_cluster
from merging.config import MergeConfig
from tbmslam.grid import TbmGrid
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch
from tbmslam.worker_pool import worker_pool

logger = logging.getLogger(__name__)

Pair = tuple[str, str]


def align_all(
    maps: Mapping[str, TbmMap],
    config: MergeConfig,
    workers: int = 1,
    watch: Watch | None = None,
    scheduler: str | None = None,
    pairs: Sequence[Pair] | None = None,
) -> dict[Pair, Alignment]:
    """Align every pair of maps, or some pairs; the one named first is the target.

    Parameters
    ----------
    maps
        Maps by name.
    config
        How they are aligned.
    workers
        Processes to share the work; every number gives the same alignments.
    watch
        Who is told how far it is.
    scheduler
        Address of a Dask scheduler whose workers share the work instead.
    pairs
        The pairs wanted; every one where None.

    Raises
    ------
    ValueError
        If there is no worker.
    ClusterError
        If the cluster cannot be reached or gives up.
    WorkerDiedError
        If a process of this machine died.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    watch = watch or Watch()
    grids = {name: one.grid for name, one in maps.items()}
    resolution = comparison_resolution(list(grids.values()), config)
    pairs = list(itertools.combinations(maps, 2)) if pairs is None else pairs
    workers = min(workers, len(pairs))
    if scheduler is not None:
        found = align_on_cluster(pairs, grids, resolution, config, scheduler, watch)
    elif workers <= 1:
        crew = _Crew(grids, resolution, config)
        found = [crew.align(pair) for pair in watch.each(pairs, "aligning", len(pairs), "pairs")]
    else:
        with worker_pool(workers, partial(_hire, grids, resolution, config)) as pool:
            found = list(watch.each(pool.map(_align, pairs), "aligning", len(pairs), "pairs"))
    for (target, source), one in zip(pairs, found, strict=True):
        logger.info("%s in %s: %s: %s", source, target, "accepted" if one.accepted else "refused", one.reason)
    return dict(zip(pairs, found, strict=True))


class _Crew:
    """What one process needs to align pairs; a map is looked at once, when its first pair comes."""

    def __init__(self, grids: Mapping[str, TbmGrid], resolution: float, config: MergeConfig) -> None:
        self._grids, self._resolution, self._config = grids, resolution, config
        self._views: dict[str, View | None] = {}

    def align(self, pair: Pair) -> Alignment:
        """Align one pair (target, source)."""
        target, source = (self._view(name) for name in pair)
        return align_views(target, source, self._config)

    def _view(self, name: str) -> View | None:
        if name not in self._views:
            self._views[name] = view_of(self._grids[name], self._resolution, self._config)
        return self._views[name]


_here: list[_Crew] = []
"""The crew of this process, where it is a worker."""


def _hire(grids: Mapping[str, TbmGrid], resolution: float, config: MergeConfig) -> None:
    _here[:] = [_Crew(grids, resolution, config)]


def _align(pair: Pair) -> Alignment:
    return _here[0].align(pair)
