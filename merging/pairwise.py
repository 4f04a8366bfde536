"""Every pair of some maps aligned: in this process, in several processes, or on a cluster."""

import itertools
import logging
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.fusion.warping import CellSizeError
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution, prepared
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class CompressedGrid:
    """A grid that takes little space when it is pickled: most of it is unknown."""

    grid: TbmGrid

    def __reduce__(self) -> tuple[Callable[..., "CompressedGrid"], tuple[GridGeometry, bytes]]:
        """Return what to call to get it back, and with what."""
        masses = np.ascontiguousarray(self.grid.masses, dtype=np.float32)
        return _decompressed, (self.grid.geometry, zlib.compress(masses.tobytes(), level=1))


def _decompressed(geometry: GridGeometry, data: bytes) -> CompressedGrid:
    masses = np.frombuffer(bytearray(zlib.decompress(data)), dtype=np.float32)
    return CompressedGrid(TbmGrid(geometry, masses.reshape(geometry.rows, geometry.cols, 4)))


class PreparedMaps:
    """Looks at maps when they are first asked for.

    A coarse map costs only the pairs that it is in: the others are compared in their own, finer cells.

    Parameters
    ----------
    grids
        The maps' grids by name.
    config
        How they are looked at.
    """

    def __init__(self, grids: Mapping[str, TbmGrid], config: MergeConfig) -> None:
        self._grids, self._config = grids, config
        self._views: dict[tuple[str, float], PreparedMap | None] = {}

    def of_pair(self, pair: Pair) -> tuple[PreparedMap | None, PreparedMap | None]:
        """Return both maps of a pair, target and source, in cells of one size; None for one of which nothing is known.

        Raises
        ------
        CellSizeError
            If no map has cells of such a size, or one of the two is far too large for it.
        """
        target, source = pair
        resolution = comparison_resolution([self._grids[target], self._grids[source]], self._config)
        return self._view(target, resolution), self._view(source, resolution)

    def _view(self, name: str, resolution: float) -> PreparedMap | None:
        look = name, resolution
        if look not in self._views:
            self._views[look] = prepared_by_name(name, self._grids[name], resolution, self._config)
        return self._views[look]


def prepared_by_name(name: str, grid: TbmGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    """Return a map as `merging.rigid_alignment.prepared` does; an error says which map it is.

    Raises
    ------
    CellSizeError
        If the map is far too large for cells of that size.
    """
    try:
        return prepared(grid, resolution, config)
    except CellSizeError as error:
        raise CellSizeError(f"{name}: {error}") from None


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
