"""Every pair of maps as a card: the decision, its reason, and pictures of the walls."""

import math
from collections.abc import Mapping, Sequence

from merging.alignment import Alignment, Pair, PoseHypothesis, format_confidence, format_covariance, format_pose
from merging.config import MergeConfig
from merging.map_graph.links import is_same_pose
from merging.merger import Merge
from merging.pair_picture import CAPTION, EVIDENCE_GRIDS, draw_alone, draw_pair
from merging.pairwise import PreparedMaps
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.page import Card, Picture, Table

MOST_CARDS = 60
"""Further pairs are listed in a table: pictures of thousands would make the page too large to open."""


def pair_cards(merge: Merge, maps: Mapping[str, TbmMap], config: MergeConfig) -> tuple[list[Card], list[Table]]:
    """Return the cards of the most important pairs, and a table of the others if there are more."""
    found = merge.alignments
    ranks = {pair: (one.accepted, one.ambiguous, one.agreed_wall_m) for pair, one in found.items()}
    important = set(sorted(found, key=ranks.__getitem__, reverse=True)[:MOST_CARDS])
    # The pictures show walls, whichever method found the alignment.
    walls = config.model_copy(update={"method": "correlation"})
    views = PreparedMaps({name: tbm_map.grid for name, tbm_map in maps.items()}, walls)
    cards = [
        Card(
            title=f"{pair[1]} in {pair[0]}",
            verdict=_verdict(pair, merge),
            good=(merge.alignments[pair].accepted or pair in merge.used) and pair not in merge.outvoted,
            reason=f"{merge.alignments[pair].reason[:1].upper()}{merge.alignments[pair].reason[1:]}.",
            figures=_figures(merge.alignments[pair]),
            copied=_pose_words(pair, merge, config),
            pictures=_pictures(pair, merge, views, walls),
        )
        for pair in merge.alignments
        if pair in important
    ]
    others = [pair for pair in merge.alignments if pair not in important]
    return cards, [_table(others, merge)] if others else []


def hypothesis_used(pair: Pair, merge: Merge, config: MergeConfig) -> PoseHypothesis:
    """Return the most confident hypothesis of a used pair that agrees with the poses of its maps.

    It may be an alternative of the alignment.
    """
    hypotheses = merge.alignments[pair].hypotheses()
    motion = merge.poses[pair[0]].inverse() @ merge.poses[pair[1]]
    agreeing = [
        each for each in hypotheses if is_same_pose(motion, each.T_target_source, config.graph, each.covariance)
    ]
    # Joint optimisation may have moved a map away from all of them.
    return max(agreeing or hypotheses, key=lambda each: each.confidence)


def _verdict(pair: Pair, merge: Merge) -> str:
    found = merge.alignments[pair]
    if pair in merge.outvoted:
        return "accepted, but outvoted"
    if found.accepted:
        return "accepted"
    if pair in merge.used:
        return "confirmed by others"
    return "ambiguous" if found.ambiguous else "refused"


def _figures(found: Alignment) -> dict[str, str]:
    figures = {"confidence": format_confidence(found.confidence)}
    if found.T_target_source is not None:
        x, y, degrees = format_pose(found.T_target_source)
        figures |= {"x": f"{x} m", "y": f"{y} m", "θ": f"{degrees}°"}
    if found.covariance is not None:
        figures["exact to"] = format_covariance(found.covariance)
    figures |= {"overlap": f"{found.overlap_m2:.1f} m²", "walls agree": f"{found.agreed_wall_m:.1f} m"}
    figures |= {"agreement": f"{found.agreement:.0%}", "contradiction": f"{found.conflict:.0%}"}
    if found.rmse_m is not None and math.isfinite(found.rmse_m):
        figures["rmse"] = f"{found.rmse_m:.3f} m"
    if found.scale is not None and math.isfinite(found.scale):
        figures["scale"] = f"{found.scale:.3f}"
    if found.method == "features":
        figures["inliers"] = f"{found.inliers} of {found.matches}"
    return figures


def _pose_words(pair: Pair, merge: Merge, config: MergeConfig) -> str:
    """Return the pose as the argument X Y DEG of `--pose`; empty if it is unknown."""
    pose = merge.alignments[pair].T_target_source
    if pose is None:
        return ""
    x, y, theta = hypothesis_used(pair, merge, config).T_target_source if pair in merge.used else pose
    return f"{x:.4f} {y:.4f} {math.degrees(theta):.3f}"


def _pictures(pair: Pair, merge: Merge, views: PreparedMaps, config: MergeConfig) -> Sequence[Picture]:
    found, caption = merge.alignments[pair], CAPTION
    if pair in merge.evidence_grids:
        views, caption = (
            PreparedMaps(dict(zip(pair, merge.evidence_grids[pair], strict=True)), config),
            f"{CAPTION} {EVIDENCE_GRIDS}",
        )
    target, source = views.of_pair(pair)
    if target is None or source is None or found.T_target_source is None:
        alone = [(name, view) for name, view in zip(pair, (target, source), strict=True) if view is not None]
        return [Picture(draw_alone(view.structure), f"The walls of {name}.") for name, view in alone]
    places = [(found.T_target_source, caption.format(target=pair[0], source=pair[1]))]
    places += [(other.T_target_source, _caption(number, other)) for number, other in enumerate(found.alternatives, 1)]
    return [
        Picture(draw_pair(target.structure, source.structure, motion, config.verification), caption)
        for motion, caption in places
    ]


def _caption(number: int, other: PoseHypothesis) -> str:
    x, y, degrees = format_pose(other.T_target_source)
    where = f"Alternative {number}, at {x} m, {y} m, {degrees}°"
    return f"{where}: confidence {format_confidence(other.confidence)}, {other.agreed_wall_m:.1f} m of wall agree."


def _table(pairs: Sequence[Pair], merge: Merge) -> Table:
    rows = [
        (target, source, _verdict((target, source), merge), format_confidence(found.confidence), found.reason)
        for target, source in pairs
        for found in [merge.alignments[target, source]]
    ]
    return Table("Further pairs", ("target", "source", "", "#confidence", "reason"), rows)
