"""Groups of maps, each as one map that can be aligned."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair
from merging.config import MergeConfig
from merging.fusion.warping import CellSizeError, corners_of
from merging.map_graph.grouping import Group
from merging.merged_group import merge_group
from merging.pairwise.all_pairs import align_all
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_check import MAX_CELLS
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tbmslam.parallel.progress import Watch

logger = logging.getLogger(__name__)

_ALL_THEY_KNOW: dict[str, object] = {"rule": None, "coverage": "union", "reliability": {}, "merged_resolution": None}


@dataclass(frozen=True)
class GroupMap:
    """Some maps as one.

    Parameters
    ----------
    grid
        Its cells.
    poses
        T_whole_map of every map in it.
    """

    grid: TbmGrid
    poses: Mapping[str, SE2]

    @classmethod
    def of(cls, maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: MergeConfig, watch: Watch) -> "GroupMap":
        """Merge maps of which is known how they lie to each other, T_any_map; one map stays as it is.

        Whatever the user wants the merged map to hold, what the maps know together is all that any of them knows. Its
        frame is that of the map that knows most.

        Raises
        ------
        CellSizeError
            If they reach so far that they would have too many cells.
        """
        first, *others = most_known_first(maps, poses)
        if not others:
            return cls(maps[first].grid, {first: SE2.identity()})
        T_first = poses[first].inverse()
        poses = {first: SE2.identity()} | {name: T_first @ poses[name] for name in others}
        cell_m = maps[first].grid.geometry.resolution
        _check_extent(maps, poses, min(cell_m, config.resolution or cell_m))
        merged = merge_group(maps, Group(poses), config.model_copy(update=_ALL_THEY_KNOW), watch)
        return cls(merged.merged.grid, merged.poses)


def group_maps_of(
    maps: Mapping[str, TbmMap], groups: Mapping[str, Mapping[str, SE2]], config: MergeConfig, watch: Watch
) -> dict[str, GroupMap]:
    """Return groups, T_any_map of their maps, as wholes by the same names; those too large to be one are left out."""
    wholes = {}
    for group, poses in groups.items():
        try:
            wholes[group] = GroupMap.of(maps, poses, config, watch)
        except (CellSizeError, MemoryError) as error:
            why = str(error) if isinstance(error, CellSizeError) else "memory has run out"
            logger.warning("%s are not looked at as one map: %s", ", ".join(poses), why)
    return wholes


def most_known_first(maps: Mapping[str, TbmMap], names: Iterable[str]) -> list[str]:
    """Return the names of some maps, that of the one that knows most first: who is named first must not matter."""
    names = list(names)
    if len(names) == 1:
        return names
    grids = {name: maps[name].grid for name in names}
    known_m2 = {name: np.count_nonzero(one.is_known()) * one.geometry.resolution**2 for name, one in grids.items()}
    return sorted(names, key=lambda name: -known_m2[name])


def _check_extent(maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], cell_m: float) -> None:
    """Refuse maps that would have too many cells together, before room is made for these."""
    corners = [corners_of(maps[name].grid.known_part().geometry, pose) for name, pose in poses.items()]
    width, height = np.ptp(np.concatenate(corners), axis=0)
    cells = width * height / cell_m**2
    if not cells <= MAX_CELLS:
        raise CellSizeError(
            f"{width:.0f} x {height:.0f} m in cells of {cell_m:g} m would be {cells:.2g} cells, more than the "
            f"{MAX_CELLS:.0e} that are possible"
        )


def align_group_maps(
    wholes: Mapping[str, GroupMap],
    pairs: Sequence[Pair],
    config: MergeConfig,
    executor: Executor,
) -> dict[Pair, Alignment]:
    """Align pairs of groups, by their names; see `merging.pairwise.all_pairs.align_all`."""
    return align_all({name: TbmMap(whole.grid) for name, whole in wholes.items()}, config, executor, pairs)
