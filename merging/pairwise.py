"""Every pair of some maps aligned: in this process, in several processes, or on a cluster."""

import itertools
import logging
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.fusion import CellSizeError
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution, prepared
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


class _Packed(NamedTuple):
    """A grid as it is sent."""

    geometry: GridGeometry
    masses: bytes

    @classmethod
    def of(cls, grid: TbmGrid) -> "_Packed":
        masses = np.ascontiguousarray(grid.masses, dtype=np.float32)
        return cls(grid.geometry, zlib.compress(masses.tobytes(), level=1))

    def unpacked(self) -> TbmGrid:
        masses = np.frombuffer(bytearray(zlib.decompress(self.masses)), dtype=np.float32)
        return TbmGrid(self.geometry, masses.reshape(self.geometry.rows, self.geometry.cols, 4))


class CompressedGrid:
    """A grid that takes little space where it is sent to: most of it is unknown.

    Parameters
    ----------
    grid
        The grid.
    """

    def __init__(self, grid: TbmGrid | _Packed) -> None:
        self._held = grid

    @property
    def grid(self) -> TbmGrid:
        """The grid; where it was sent to it is unpacked each time."""
        return self._held.unpacked() if isinstance(self._held, _Packed) else self._held

    def __reduce__(self) -> tuple[type["CompressedGrid"], tuple[_Packed]]:
        """Return what to call to get it back, and with what."""
        return CompressedGrid, (self._held if isinstance(self._held, _Packed) else _Packed.of(self._held),)


def most_held(grids: Iterable[TbmGrid], cells: float) -> int:
    """Return how many maps have so many cells together, were each as large as the largest; two at least."""
    return max(int(cells / max(one.geometry.rows * one.geometry.cols for one in grids)), 2)


_HELD_CELLS = 1.3e8
"""Maps that were looked at take 11 bytes a cell: a process holds 1.4 GB of them."""


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
    held = most_held(grids.values(), _HELD_CELLS)
    found: list[Alignment] = executor.results(_calls(pairs, grids, config), "aligning", "pairs", held)
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
