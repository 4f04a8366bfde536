"""Groups of maps, each as one map that can be aligned."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from merging.alignment import Alignment, Pair
from merging.all_pairs import align_all
from merging.config import MergeConfig
from merging.map_graph import Group
from merging.merged_group import merge_group
from merging.warping import place
from merging.workforce import Workforce
from tbmslam.grid import TbmGrid
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tbmslam.watch import Watch

_ALL_THEY_KNOW: dict[str, object] = {"rule": None, "coverage": "union", "reliability": {}, "merged_resolution": None}


@dataclass(frozen=True)
class WholeGroup:
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
    def of(
        cls, maps: Mapping[str, TbmMap], poses: Mapping[str, SE2], config: MergeConfig, watch: Watch
    ) -> "WholeGroup":
        """Merge maps of which is known how they lie to each other, T_any_map; one map stays as it is.

        Whatever the user wants the merged map to hold, what the maps know together is all that any of them knows.
        """
        first = next(iter(poses))
        if len(poses) == 1:
            return cls(maps[first].grid, {first: SE2.identity()})
        config = config.model_copy(update=_ALL_THEY_KNOW)
        T_first = poses[first].inverse()
        merged = merge_group(maps, Group({name: T_first @ pose for name, pose in poses.items()}), config, watch)
        return cls(merged.merged.grid, merged.poses)

    def seen_in(self, name: str) -> TbmGrid:
        """Return its cells in the frame of one of its maps."""
        pose = self.poses[name]
        return self.grid if pose == SE2.identity() else place(self.grid, pose.inverse(), self.grid.geometry).drawn()


def align_wholes(
    wholes: Mapping[str, WholeGroup],
    pairs: Sequence[Pair],
    config: MergeConfig,
    workforce: Workforce,
) -> dict[Pair, Alignment]:
    """Align pairs of groups, by their names; see `merging.all_pairs.align_all`."""
    return align_all({name: TbmMap(whole.grid) for name, whole in wholes.items()}, config, workforce, pairs)


def names_in(pairs: Iterable[Pair]) -> list[str]:
    """Return the names in some pairs, each once, in their order."""
    return list(dict.fromkeys(itertools.chain.from_iterable(pairs)))
