"""What one look after the other finds of maps that are to be merged."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from merging.alignment import Alignment, Pair
from merging.map_graph.grouping import Group
from tbmslam.belief.grid import TbmGrid
from tbmslam.map.tbm_map import TbmMap

Grouping = Callable[[Mapping[Pair, Alignment]], Sequence[Group]]


@dataclass(frozen=True)
class MergeState:
    """What is known so far.

    Parameters
    ----------
    grouping
        How alignments join maps.
    maps
        The maps by name, those that were straightened as they are now.
    alignments
        The surest answer for every pair.
    groups
        What these join, the largest first.
    judged_by
        The grids (target, source), each in its map's frame, that an alignment was judged by where they are not the
        maps' own.
    straightened
        The maps that were straightened.
    """

    grouping: Grouping
    maps: Mapping[str, TbmMap]
    alignments: Mapping[Pair, Alignment]
    groups: Sequence[Group]
    evidence_grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]] = field(default_factory=dict)
    straightened: Mapping[str, TbmMap] = field(default_factory=dict)

    @classmethod
    def of(cls, maps: Mapping[str, TbmMap], alignments: Mapping[Pair, Alignment], grouping: Grouping) -> "MergeState":
        """Return what a first look found."""
        return cls(grouping, maps, alignments, grouping(alignments))

    @cached_property
    def _numbers(self) -> Mapping[str, int]:
        """The number of the group that each map is in."""
        return {name: number for number, group in enumerate(self.groups) for name in group.poses}

    def group_of(self, name: str) -> Group:
        """Return the group that a map is in."""
        return self.groups[self._numbers[name]]

    def are_joined(self, pair: Pair) -> bool:
        """Return whether the maps of a pair are in one group."""
        return self._numbers[pair[0]] == self._numbers[pair[1]]

    def apart(self) -> list[Pair]:
        """Return the pairs that were aligned and whose maps are in different groups."""
        return [pair for pair in self.alignments if not self.are_joined(pair)]

    def with_alignments(
        self, found: Mapping[Pair, Alignment], evidence_grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]] | None = None
    ) -> "MergeState":
        """Return the same with better answers for some pairs, and the grids they were judged by."""
        alignments = {**self.alignments, **found}
        evidence_grids = {**self.evidence_grids, **(evidence_grids or {})}
        return replace(self, alignments=alignments, groups=self.grouping(alignments), evidence_grids=evidence_grids)

    def with_straightened(self, name: str, straightened: TbmMap) -> "MergeState":
        """Return the same with one of the maps straightened."""
        return replace(
            self, maps={**self.maps, name: straightened}, straightened={**self.straightened, name: straightened}
        )

    def with_own_grids(self, pair: Pair) -> "MergeState":
        """Return the same with a pair judged by its grids as they are now."""
        grids = self.maps[pair[0]].grid, self.maps[pair[1]].grid
        return replace(self, evidence_grids={**self.evidence_grids, pair: grids})
