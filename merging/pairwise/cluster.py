"""Pairs of maps aligned on a cluster: each map is looked at once in each cell size, its look shared by its pairs."""

import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution, prepared
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.parallel.cluster import Cluster
from tbmslam.parallel.progress import Watch

Packed = tuple[GridGeometry, bytes]
"""A grid in little space: most of it is unknown."""


def align_on_cluster(
    pairs: Sequence[Pair],
    grids: Mapping[str, TbmGrid],
    config: MergeConfig,
    scheduler: str,
    watch: Watch,
) -> list[Alignment]:
    """Return the alignment of each pair (target, source).

    Parameters
    ----------
    pairs
        Names of maps.
    grids
        The maps.
    config
        How they are aligned.
    scheduler
        Address of a Dask scheduler.
    watch
        Who is told how far it is.

    Raises
    ------
    ClusterError
        The cluster cannot be reached or gives up.
    """
    sizes = [comparison_resolution([grids[name] for name in pair], config) for pair in pairs]
    looks = dict.fromkeys((name, size) for pair, size in zip(pairs, sizes, strict=True) for name in pair)
    with Cluster(scheduler) as cluster:
        # A map goes along with the work, so that it is not lost with the worker that has it.
        views = {
            (name, size): cluster.submit(f"view {name} {size}", prepared_from_packed, pack(grids[name]), size, config)
            for name, size in looks
        }
        submitted = [
            cluster.submit(f"{source} in {target}", align_prepared, views[target, size], views[source, size], config)
            for (target, source), size in zip(pairs, sizes, strict=True)
        ]
        return list(watch.each(cluster.results(submitted), "aligning", len(pairs), "pairs"))


def prepared_from_packed(packed: Packed, resolution: float, config: MergeConfig) -> PreparedMap | None:
    """Look at a packed grid; see `merging.rigid_alignment.prepared`."""
    return prepared(unpack(packed), resolution, config)


def pack(grid: TbmGrid) -> Packed:
    """Return a grid in little space."""
    return grid.geometry, zlib.compress(np.ascontiguousarray(grid.masses, dtype=np.float32).tobytes(), level=1)


def unpack(packed: Packed) -> TbmGrid:
    """Return the grid that was packed."""
    geometry, data = packed
    masses = np.frombuffer(bytearray(zlib.decompress(data)), dtype=np.float32)
    return TbmGrid(geometry, masses.reshape(geometry.rows, geometry.cols, 4))
