"""Every pair of some maps aligned, in several processes where that is wanted."""

import itertools
import logging
from collections.abc import Mapping, Sequence

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.pairwise.compressed_grid import CompressedGrid
from merging.pairwise.prepared_maps import prepared_by_name
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution
from tbmslam.belief.grid import TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

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
    grids = {name: one.grid for name, one in maps.items()}
    pairs = list(itertools.combinations(maps, 2)) if pairs is None else pairs
    found: list[Alignment] = executor.results(_calls(pairs, grids, config), "aligning", "pairs")
    for (target, source), one in zip(pairs, found, strict=True):
        logger.info("%s in %s: %s: %s", source, target, "accepted" if one.accepted else "refused", one.reason)
    return dict(zip(pairs, found, strict=True))


def _calls(pairs: Sequence[Pair], grids: Mapping[str, TbmGrid], config: MergeConfig) -> list[Call]:
    """Return the calls that align pairs; each map is prepared once in each cell size, and shared by its pairs."""
    sizes = [comparison_resolution([grids[name] for name in pair], config) for pair in pairs]
    sent = {name: CompressedGrid(grid) for name, grid in grids.items()}
    views = {
        (name, size): Call(f"view {name} {size}", _prepared, (name, sent[name], size, config))
        for pair, size in zip(pairs, sizes, strict=True)
        for name in pair
    }
    return [
        Call(f"{source} in {target}", align_prepared, (views[target, size], views[source, size], config))
        for (target, source), size in zip(pairs, sizes, strict=True)
    ]


def _prepared(name: str, sent: CompressedGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    return prepared_by_name(name, sent.grid, resolution, config)
