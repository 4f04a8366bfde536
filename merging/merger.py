"""Merges maps with unknown relative poses, and aligns two of them."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from merging.alignment import Alignment, Pair
from merging.bridges.refutation import without_refuted_bridges
from merging.config import MergeConfig
from merging.fusion import Fusion
from merging.joint_slam import JointRefinement
from merging.map_graph.grouping import Group, groups_of
from merging.merge_state import MergeState, best_pair_picture, check_maps, most_confident_pair, why_alone, why_left_out
from merging.merged_group import MergedGroup, merge_group
from merging.nonrigid.propagation import deformed_maps
from merging.nonrigid.search import align_deformable, register_pairs
from merging.pair_picture import EVIDENCE_GRIDS
from merging.pairwise import with_picture
from merging.pose_priors import place_by_priors
from merging.rounds import with_pairs_aligned, with_short_range_alignments
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor, Progress


@dataclass(frozen=True, repr=False)
class Merge:
    """The result of a merge."""

    merged: TbmMap | None
    """The merged map, in the frame of the first map that went into it; None if no two maps could be aligned."""
    poses: Mapping[str, SE2]
    """T_merged_map of every merged map."""
    alignments: Mapping[Pair, Alignment]
    """The alignment of every aligned pair (target, source); refused ones have a reason."""
    left_out: Mapping[str, str]
    """The maps that were not merged, with the reasons."""
    fusion: Fusion | None
    """The merged cells with their conflict; None if there is no merged map."""
    joint: JointRefinement | None = None
    """The joint optimisation of the drives; None for a rigid merge."""
    used: tuple[Pair, ...] = ()
    outvoted: tuple[Pair, ...] = ()
    """The pairs whose alignments agree with the poses, and the pairs whose accepted alignments do not."""
    evidence_grids: Mapping[Pair, tuple[TbmGrid, TbmGrid]] = field(default_factory=dict)
    """The grids (target, source) of an alignment, each in its map's frame, if these are not the grids of the maps but
    were rendered from short ranges or deformed."""
    deformed: Mapping[str, TbmMap] = field(default_factory=dict)
    """The deformed maps by name, which were merged instead of the given ones."""

    def __repr__(self) -> str:
        """Return which maps were merged, and why the others were not, one line each."""
        count = len(self.poses) + len(self.left_out)
        merged = f"merged {', '.join(self.poses)}" if self.poses else "merged none"
        left_out, best = [f"  {n}: {why}" for n, why in self.left_out.items()], most_confident_pair(self.alignments)
        return "\n".join([f"Merge of {count} maps: {merged}", *left_out, *([] if self.poses else best)])

    def _repr_png_(self) -> bytes | None:
        """Return the picture that a notebook shows: the merged map, if there is one."""
        return None if self.merged is None else self.merged._repr_png_()

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the text, and the merged map or else the picture of the most confident pair."""
        lines = "".join(f"<p>{html.escape(line.strip())}</p>" for line in repr(self).splitlines())
        return lines + (best_pair_picture(self.alignments) if self.merged is None else self.merged._repr_html_())

    def laid(self, name: str, maps: Mapping[str, TbmMap]) -> tuple[TbmGrid, SE2]:
        """Return the grid of a merged map, after joint optimisation, and its pose in the merged map."""
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
    """Merge maps with unknown relative poses.

    Every pair of maps is aligned; with many maps only similar pairs are aligned (`merging.rounds`). Alignments that
    agree join maps into groups. If one or two alignments join two groups, the groups must match as wholes. Maps with
    keyframes in different groups are then aligned again by short ranges only. Refused pairs are registered
    non-rigidly, as are accepted pairs that alone join a map. The largest group is fused in the order of the maps. If
    poses are known (`MergeConfig.known_poses`), the group of these maps is fused instead.

    Parameters
    ----------
    maps
        Two maps or more, by name; the merged map has the frame of its first map in this order.
    config
        The parameters; None for the defaults.
    workers, scheduler
        Processes that align pairs, or the address of a Dask scheduler whose workers do; the result is the same.
    progress
        Receives the duration of each step and its progress.

    Raises
    ------
    ValueError, TypeError
        For fewer than two maps, maps that are no mapping, no worker, or a known pose of an unknown map or of the first
        one.
    """
    check_maps(maps)
    config, executor = config or MergeConfig(), Executor(workers, scheduler, progress or Progress())
    known = place_by_priors(maps, config)
    grouping = partial(_grouped, list(maps), config, executor.progress, known.poses)
    found = with_pairs_aligned(MergeState.of(maps, known.alignments, grouping), config, executor)
    found = without_refuted_bridges(found, config, executor.progress)
    again = with_short_range_alignments(found, config, executor)
    found = without_refuted_bridges(again, config, executor.progress, set(found.apart()))
    found = _with_deformed_maps(found, config, executor)
    group = found.groups[0]
    joined = merge_group(found.maps, group, config, executor.progress) if len(group) > 1 else None
    return _with_pictures(_merged(found, joined), maps, config)


def align(target: TbmMap, source: TbmMap, config: MergeConfig | None = None) -> Alignment:
    """Estimate the pose of a source map in the frame of a target map, without an initial guess.

    The maps are aligned rigidly; one of them is deformed if that is refused or fits much worse. `merging.merge` also
    aligns maps with keyframes again by short ranges.

    Parameters
    ----------
    target, source
        The maps, as `tbmslam.load_map` or `tbmslam.Slam.finish` returns them; their cells may differ in size.
    config
        The parameters; None for the defaults.

    Returns
    -------
    The alignment; a refused one has a reason. A notebook shows it as a picture.

    Raises
    ------
    CellSizeError
        If the maps cannot be brought into cells of one size.
    """
    config = config or MergeConfig()
    return with_picture(align_deformable(target, source, config), (target.grid, source.grid), config)


def _with_pictures(done: Merge, maps: Mapping[str, TbmMap], config: MergeConfig) -> Merge:
    own = {pair: (maps[pair[0]].grid, maps[pair[1]].grid) for pair in done.alignments} | {**done.evidence_grids}
    notes = dict.fromkeys(done.evidence_grids, EVIDENCE_GRIDS)
    drawn = {
        pair: with_picture(found, own[pair], config, notes.get(pair, "")) for pair, found in done.alignments.items()
    }
    return replace(done, alignments=drawn)


def _grouped(
    names: Sequence[str],
    config: MergeConfig,
    progress: Progress,
    known: Mapping[str, SE2],
    alignments: Mapping[Pair, Alignment],
) -> list[Group]:
    with progress.during("grouping"):
        return groups_of(names, alignments, config.graph, known)


def _with_deformed_maps(found: MergeState, config: MergeConfig, executor: Executor) -> MergeState:
    """Register pairs of maps non-rigidly; keep the deformed maps unless their bridge is refuted."""
    registrations = register_pairs(found, config, executor)
    if not registrations:
        return found
    rigid = {pair: found.alignments[pair] for pair in registrations if found.alignments[pair].accepted}
    without = {pair: replace(alignment, accepted=False, confidence=0.0) for pair, alignment in rigid.items()}
    before, apart = found.with_alignments(without).groups, set(found.apart())
    found = found.with_alignments({pair: registration.alignment for pair, registration in registrations.items()})
    found = without_refuted_bridges(found, config, executor.progress, apart)
    kept = {pair: each for pair, each in registrations.items() if found.alignments[pair].accepted}
    found = found.with_deformed(deformed_maps(kept, found.maps, found.groups, before))
    return found.with_own_grids([pair for pair in kept if any(pair in group.used for group in found.groups)])


def _merged(found: MergeState, joined: MergedGroup | None) -> Merge:
    if joined is None:
        left_out = {name: why_alone(name, found.alignments) for name in found.maps}
        return Merge(None, {}, found.alignments, left_out, None, evidence_grids=found.evidence_grids)
    group = found.groups[0]
    left_out = {name: why_left_out(name, group, found.alignments) for name in found.maps if name not in group.poses}
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
        {name: deformed for name, deformed in found.deformed.items() if name in joined.poses},
    )
