"""Alignment of pairs of maps: in this process, in several processes, or on a cluster."""

import itertools
import logging
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.fusion import CellSizeError
from merging.pair_picture import ComparedGrids
from merging.rigid_alignment import PreparedMap, align_prepared, comparison_resolution, prepared
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.tiled_masses import SIDE, Place, TiledMasses
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Call, Executor

logger = logging.getLogger(__name__)


class _Packed(NamedTuple):
    """A compressed grid."""

    geometry: GridGeometry
    places: list[Place]
    first: tuple[int, int]
    """The places of the tiles, and the first cell, as in `TiledMasses`."""
    tiles: bytes

    @classmethod
    def of(cls, grid: TbmGrid) -> "_Packed":
        cells = grid.cells if isinstance(grid.cells, TiledMasses) else TiledMasses.of(grid.cells)
        tiles = b"".join(tile.tobytes() for tile in cells.tiles.values())
        return cls(grid.geometry, list(cells.tiles), cells.first, zlib.compress(tiles, level=1))

    def unpacked(self) -> TbmGrid:
        masses = np.frombuffer(zlib.decompress(self.tiles), dtype=np.float32).reshape(-1, SIDE, SIDE, 4)
        tiles = dict(zip(self.places, masses, strict=True))
        return TbmGrid(self.geometry, TiledMasses(self.geometry.rows, self.geometry.cols, tiles, self.first))


class CompressedGrid:
    """A grid that is compressed when it is sent to another process."""

    def __init__(self, grid: TbmGrid | _Packed) -> None:
        self._held = grid

    @property
    def grid(self) -> TbmGrid:
        """The grid; a received grid is decompressed at each access."""
        return self._held.unpacked() if isinstance(self._held, _Packed) else self._held

    def __reduce__(self) -> tuple[type["CompressedGrid"], tuple[_Packed]]:
        """Return the constructor and its argument, for pickle."""
        return CompressedGrid, (self._held if isinstance(self._held, _Packed) else _Packed.of(self._held),)


def most_held(grids: Iterable[TbmGrid], cells: float) -> int:
    """Return the number of maps that fit into a number of cells if all have the largest size; at least two."""
    return max(int(cells / max(tbm_map.geometry.rows * tbm_map.geometry.cols for tbm_map in grids)), 2)


_HELD_CELLS = 1.3e8
"""Cells of prepared maps that a process holds: 9 bytes each, so 1.2 GB."""


class PreparedMaps:
    """Prepares maps at their first use.

    The resolution is chosen for each pair, so a coarse map affects only its own pairs.
    """

    def __init__(self, grids: Mapping[str, TbmGrid], config: MergeConfig) -> None:
        self._grids, self._config = grids, config
        self._prepared: dict[tuple[str, float], PreparedMap | None] = {}

    def of_pair(self, pair: Pair) -> tuple[PreparedMap | None, PreparedMap | None]:
        """Return target and source at one resolution, None without known cells, or raise a `CellSizeError`."""
        target, source = pair
        resolution = comparison_resolution([self._grids[target], self._grids[source]], self._config)
        return self._at(target, resolution), self._at(source, resolution)

    def _at(self, name: str, resolution: float) -> PreparedMap | None:
        key = name, resolution
        if key not in self._prepared:
            self._prepared[key] = prepared_by_name(name, self._grids[name], resolution, self._config)
        return self._prepared[key]


def prepared_by_name(name: str, grid: TbmGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    """Prepare a map as `merging.rigid_alignment.prepared`; a `CellSizeError` names the map."""
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
    """Align some or all pairs of maps, in this process without an executor; the first map of a pair is the target.

    Raises a `ClusterError` if the cluster cannot be reached or gives up, and a `WorkerDiedError` if a local process
    died.
    """
    executor = executor or Executor()
    grids = {name: tbm_map.grid for name, tbm_map in maps.items()}
    pairs = list(itertools.combinations(maps, 2)) if pairs is None else pairs
    held = most_held(grids.values(), _HELD_CELLS)
    found: list[Alignment] = executor.results(_calls(pairs, grids, config), "aligning", "pairs", held)
    for (target, source), tbm_map in zip(pairs, found, strict=True):
        logger.info("%s in %s: %s: %s", source, target, "accepted" if tbm_map.accepted else "refused", tbm_map.reason)
    return dict(zip(pairs, found, strict=True))


def _calls(pairs: Sequence[Pair], grids: Mapping[str, TbmGrid], config: MergeConfig) -> list[Call]:
    """Return the calls that align pairs; each map is prepared once in each cell size, and shared by its pairs."""
    sizes = [comparison_resolution([grids[name] for name in pair], config) for pair in pairs]
    sent = {name: CompressedGrid(grid) for name, grid in grids.items()}
    views = {
        (name, size): Call(f"prepare {name} {size}", _prepared, (name, sent[name], size, config))
        for pair, size in zip(pairs, sizes, strict=True)
        for name in pair
    }
    return [
        Call(f"{source} in {target}", align_prepared, (views[target, size], views[source, size], config))
        for (target, source), size in zip(pairs, sizes, strict=True)
    ]


def _prepared(name: str, sent: CompressedGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    return prepared_by_name(name, sent.grid, resolution, config)


def with_picture(found: Alignment, grids: tuple[TbmGrid, TbmGrid], config: MergeConfig, note: str = "") -> Alignment:
    """Return an alignment that a notebook draws with the given grids (target, source)."""
    note = note or ("The picture shows both maps undeformed." if found.bent_m > 0.0 else "")
    resolution = comparison_resolution(list(grids), config)
    return replace(found, compared=ComparedGrids(*grids, resolution, config, note))
