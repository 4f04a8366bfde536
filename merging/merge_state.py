"""The state of a merge between its stages: maps, alignments, groups, and the reasons for exclusions."""

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
    """The state of a merge."""

    grouping: Grouping
    maps: Mapping[str, TbmMap]
    """The maps by name, including the deformed maps."""
    alignments: Mapping[Pair, Alignment]
    groups: Sequence[Group]
    """The groups of maps: the group of known poses first, then the largest first."""
    evidence_grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]] = field(default_factory=dict)
    """The grids (target, source), each in its map's frame, that an alignment was computed from, if not the maps'
    own."""
    deformed: Mapping[str, TbmMap] = field(default_factory=dict)

    @classmethod
    def of(cls, maps: Mapping[str, TbmMap], alignments: Mapping[Pair, Alignment], grouping: Grouping) -> "MergeState":
        """Return the state after the given alignments."""
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
        """Return the state with new alignments of some pairs, and the grids they were computed from."""
        alignments = {**self.alignments, **found}
        evidence_grids = {**self.evidence_grids, **(evidence_grids or {})}
        return replace(self, alignments=alignments, groups=self.grouping(alignments), evidence_grids=evidence_grids)

    def with_deformed(self, deformed: Mapping[str, TbmMap]) -> "MergeState":
        """Return the state with some of the maps deformed."""
        return replace(self, maps={**self.maps, **deformed}, deformed={**self.deformed, **deformed})

    def with_own_grids(self, pairs: Sequence[Pair]) -> "MergeState":
        """Return the state in which the present grids of some pairs are those that they were aligned by."""
        grids = {pair: (self.maps[pair[0]].grid, self.maps[pair[1]].grid) for pair in pairs}
        return replace(self, evidence_grids={**self.evidence_grids, **grids})


def check_maps(maps: Mapping[str, TbmMap]) -> None:
    """Refuse what is no two maps by name: a list of maps would fail far from the cause."""
    if not isinstance(maps, Mapping):
        raise TypeError(f'maps must be a dict of maps by name, such as {{"hall": hall}}, got {type(maps).__name__}')
    for name, tbm_map in maps.items():
        if not isinstance(tbm_map, TbmMap):
            raise TypeError(f"maps must hold TbmMaps, got {type(tbm_map).__name__} for {name}")
    if len(maps) < 2:
        raise ValueError(f"maps must be two or more, got {len(maps)}")


def most_confident_pair(alignments: Mapping[Pair, Alignment]) -> list[str]:
    """Return the reason of the most confident alignment in a line, which says most where nothing was merged."""
    best = _most_confident(alignments)
    return [] if best is None else [f"  most confident pair, {best[1]} in {best[0]}: {alignments[best].reason}"]


def best_pair_picture(alignments: Mapping[Pair, Alignment]) -> str:
    """Return the picture of the most confident alignment as HTML; empty if it has no pose."""
    best = _most_confident(alignments)
    return "" if best is None else alignments[best].picture_html(*best)


def _most_confident(alignments: Mapping[Pair, Alignment]) -> Pair | None:
    return max(alignments, key=lambda pair: alignments[pair].confidence, default=None)


def why_alone(name: str, alignments: Mapping[Pair, Alignment]) -> str:
    """Return why a map was not merged, if no maps were."""
    accepted = {other: found for other, found in _partners(name, alignments).items() if found.accepted}
    if not accepted:
        return "no other map could be aligned with it"
    best = max(accepted, key=lambda other: accepted[other].confidence)
    return f"its accepted alignments contradict each other; the most confident, with {best}: {accepted[best].reason}"


def why_left_out(name: str, group: Group, alignments: Mapping[Pair, Alignment]) -> str:
    """Return why a map was not merged, by its best alignment with a merged map."""
    tried = {other: found for other, found in _partners(name, alignments).items() if other in group.poses}
    if not tried:
        return "no merged map is similar to it, so it was aligned with none"
    nearest = max(tried, key=lambda other: (tried[other].accepted, tried[other].agreed_wall_m, tried[other].inliers))
    fact = "no alignment with a merged map was accepted"
    if tried[nearest].accepted:
        fact = "its accepted alignments with merged maps are outvoted"
    return f"{fact}; with {nearest}: {tried[nearest].reason}"


def _partners(name: str, alignments: Mapping[Pair, Alignment]) -> dict[str, Alignment]:
    """Return the alignments of a map with others, by the names of these."""
    return {
        target if source == name else source: found
        for (target, source), found in alignments.items()
        if name in (target, source)
    }
