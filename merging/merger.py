"""Many maps whose relative poses nobody knows become one."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from merging.alignment import Alignment, Pair
from merging.bridges import without_refuted_bridges
from merging.config import MergeConfig
from merging.fusion.fusion import Fusion
from merging.joint_slam.joint_optimisation import JointRefinement
from merging.map_graph.grouping import Group, groups_of
from merging.merge_state import MergeState
from merging.merged_group import MergedGroup, merge_group
from merging.nonrigid.propagation import deformed_maps
from merging.nonrigid.search import NonrigidRegistration, register_refused_pairs
from merging.pose_priors import place_by_priors
from merging.rounds import with_pairs_aligned
from merging.short_range import with_short_range_alignments
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tbmslam.parallel.progress import Progress

logger = logging.getLogger(__name__)


@dataclass(frozen=True, repr=False)
class Merge:
    """What became of some maps.

    Parameters
    ----------
    merged
        The merged map, in the frame of the first map that went into it; None if no two maps could be aligned.
    poses
        T_merged_map of every map that went into it.
    alignments
        What was found for every pair (target, source) that was aligned, refusals with their reasons among them.
    left_out
        The maps that did not go into it, and why.
    fusion
        The merged cells with their conflict; None if there is no merged map.
    joint
        What straightening the drives together did; None if the alignment stayed rigid.
    used, outvoted
        The pairs whose alignments agree with the poses, and those that were accepted and do not.
    judged_by
        The grids (target, source), each in its map's frame, that an alignment was judged by where they are not the
        maps' own: rendered from short ranges only, or straightened.
    straightened
        The maps that were straightened before they were laid, by name: what went into it in place of those given.
    """

    merged: TbmMap | None
    poses: Mapping[str, SE2]
    alignments: Mapping[Pair, Alignment]
    left_out: Mapping[str, str]
    fusion: Fusion | None
    joint: JointRefinement | None = None
    used: tuple[Pair, ...] = ()
    outvoted: tuple[Pair, ...] = ()
    evidence_grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]] = field(default_factory=dict)
    straightened: Mapping[str, TbmMap] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return which maps became one, and why the others did not, a line each."""
        count = len(self.poses) + len(self.left_out)
        merged = f"merged {', '.join(self.poses)}" if self.poses else "merged none"
        return "\n".join([f"Merge of {count} maps: {merged}", *(f"  {n}: {why}" for n, why in self.left_out.items())])

    def _repr_png_(self) -> bytes | None:
        """Return what a notebook shows: the merged map, where there is one."""
        return None if self.merged is None else self.merged._repr_png_()

    def laid(self, name: str, maps: Mapping[str, TbmMap]) -> tuple[TbmGrid, SE2]:
        """Return the grid of a map that went into it, straightened where it was, and its pose in the merged map."""
        if self.joint is None:
            return maps[name].grid, self.poses[name]
        return self.joint.maps[name].grid, SE2.identity()


def merge(
    maps: Mapping[str, TbmMap],
    config: MergeConfig | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    scheduler: str | None = None,
) -> Merge:
    """Merge maps whose relative poses nobody knows.

    Every pair of maps is aligned; of many maps only the pairs that look alike (`merging.rounds`). Accepted alignments
    connect maps to groups, and the largest group is fused in the order of the maps. Maps whose poses somebody knows
    (`MergeConfig.known_poses`) are a group from the start, which is fused however large others are. Maps that this
    leaves apart are aligned again by what was seen at short range. Groups that only doubtful alignments join must fit
    as wholes. Maps that are still apart are bent to fit.

    Parameters
    ----------
    maps
        Two maps or more, by name; their order decides whose frame the merged map has.
    config
        How; the defaults where None.
    workers
        Processes that align pairs; the result does not depend on it.
    progress
        Receives the duration of each step and its progress.
    scheduler
        Address of a Dask scheduler whose workers align the pairs; the result does not depend on it either.

    Raises
    ------
    ValueError
        If there are fewer than two maps or no worker, or poses are known of a map that is none of them or the first.
    """
    config, executor = config or MergeConfig(), Executor(workers, scheduler, progress or Progress())
    if len(maps) < 2:
        raise ValueError(f"maps must be two or more, got {len(maps)}")
    known = place_by_priors(maps, config)
    grouping = partial(_grouped, list(maps), config, executor.progress, known.poses)
    found = MergeState.of(maps, known.alignments, grouping)
    found = with_pairs_aligned(found, config, executor)
    found = with_short_range_alignments(found, config, executor)
    found = without_refuted_bridges(found, config, executor)
    found = _with_looks(found, register_refused_pairs(found, config, executor))
    return _merged(found, _joined(found, config, executor.progress))


def _grouped(
    names: Sequence[str],
    config: MergeConfig,
    progress: Progress,
    known: Mapping[str, SE2],
    alignments: Mapping[Pair, Alignment],
) -> list[Group]:
    with progress.during("grouping"):
        return groups_of(names, alignments, config.graph, known)


def _with_looks(found: MergeState, looks: Mapping[Pair, NonrigidRegistration]) -> MergeState:
    """Add what was found of maps that were bent, and keep them so."""
    if not looks:
        return found
    before = found.groups
    found = found.with_alignments({pair: look.alignment for pair, look in looks.items()})
    for name, straightened in deformed_maps(looks, found.maps, found.groups, before).items():
        found = found.with_straightened(name, straightened)
    for pair in looks:
        if any(pair in group.used for group in found.groups):
            found = found.with_own_grids(pair)
    return found


def _joined(found: MergeState, config: MergeConfig, progress: Progress) -> MergedGroup | None:
    return merge_group(found.maps, found.groups[0], config, progress) if len(found.groups[0]) > 1 else None


def _merged(found: MergeState, joined: MergedGroup | None) -> Merge:
    if joined is None:
        left_out = {name: _why_alone(name, found.alignments) for name in found.maps}
        return Merge(None, {}, found.alignments, left_out, None, evidence_grids=found.evidence_grids)
    group = found.groups[0]
    left_out = {name: _why_left_out(name, group, found.alignments) for name in found.maps if name not in group.poses}
    return Merge(
        joined.merged,
        joined.poses,
        found.alignments,
        left_out,
        joined.fusion,
        joined.joint,
        group.used,
        group.outvoted,
        found.evidence_grids,
        {name: one for name, one in found.straightened.items() if name in joined.poses},
    )


def _why_alone(name: str, alignments: Mapping[Pair, Alignment]) -> str:
    """Return why a map was joined with no other, where no two were."""
    accepted = {
        target if source == name else source: found
        for (target, source), found in alignments.items()
        if name in (target, source) and found.accepted
    }
    if not accepted:
        return "no other map could be aligned with it"
    surest = max(accepted, key=lambda one: accepted[one].confidence)
    was = "its accepted alignments contradict each other"
    return f"{was}; the surest, with {surest}: {accepted[surest].reason}"


def _why_left_out(name: str, group: Group, alignments: Mapping[Pair, Alignment]) -> str:
    """Return what spoke against a map's best alignment with the maps that were merged."""
    tried = {
        target if source == name else source: found
        for (target, source), found in alignments.items()
        if (target == name and source in group.poses) or (source == name and target in group.poses)
    }
    if not tried:
        return "no merged map is similar to it, so it was aligned with none"
    nearest = max(tried, key=lambda one: (tried[one].accepted, tried[one].agreed_wall_m, tried[one].inliers))
    was = "no alignment with a merged map was accepted"
    if tried[nearest].accepted:
        was = "its accepted alignments with merged maps are outvoted"
    return f"{was}; with {nearest}: {tried[nearest].reason}"
