"""Many maps: which belong together, and where each lies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from merging.alignment import Alignment
from tbmslam.se2 import SE2

Pair = tuple[str, str]
"""The names of a target and a source map."""


@dataclass(frozen=True)
class Group:
    """Maps that accepted alignments connect.

    Parameters
    ----------
    poses
        T_group_map of every map in it; the group's frame is that of its first map.
    """

    poses: Mapping[str, SE2]

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.poses)

    @property
    def first(self) -> str:
        """The map whose frame the group has."""
        return next(iter(self.poses))


def groups_of(names: Sequence[str], alignments: Mapping[Pair, Alignment]) -> list[Group]:
    """Connect maps by their best accepted alignments: a maximum spanning tree of the agreed wall in each group.

    Parameters
    ----------
    names
        The maps, in the order that decides whose frame a group has.
    alignments
        Alignments of pairs (target, source); refused ones connect nothing.

    Returns
    -------
    The groups, the largest first, and among equals the one whose first map was named first; a map that nothing
    connects is a group of its own.
    """
    tree = _spanning_tree(names, alignments)
    groups: list[Group] = []
    for name in names:
        if not any(name in group.poses for group in groups):
            poses = _poses_from(name, tree)
            groups.append(Group({member: poses[member] for member in names if member in poses}))
    return sorted(groups, key=len, reverse=True)


def _spanning_tree(names: Sequence[str], alignments: Mapping[Pair, Alignment]) -> dict[Pair, SE2]:
    """Return the motions of the tree's edges by (target, source): Kruskal's algorithm, the best alignment first."""
    group_of = {name: name for name in names}
    tree: dict[Pair, SE2] = {}
    accepted = [(pair, a, a.T_target_source) for pair, a in alignments.items() if a.accepted]
    for (target, source), _, motion in sorted(accepted, key=lambda edge: -edge[1].agreed_wall_m):
        if motion is not None and group_of[target] != group_of[source]:
            tree[target, source] = motion
            joined, absorbed = group_of[target], group_of[source]
            group_of = {name: joined if group == absorbed else group for name, group in group_of.items()}
    return tree


def _poses_from(root: str, tree: Mapping[Pair, SE2]) -> dict[str, SE2]:
    """Return T_root_map of every map that the tree connects with the root."""
    poses, frontier = {root: SE2.identity()}, [root]
    while frontier:
        here = frontier.pop()
        for (target, source), motion in tree.items():
            if target == here and source not in poses:
                poses[source] = poses[here] @ motion
                frontier.append(source)
            elif source == here and target not in poses:
                poses[target] = poses[here] @ motion.inverse()
                frontier.append(target)
    return poses
