"""Every pair of maps as a card: what was decided, why, and pictures to judge it by."""

import math
from collections.abc import Mapping, Sequence

from merging.alignment import Alignment, Alternative, Pair, format_confidence, format_covariance, format_pose
from merging.config import MergeConfig
from merging.merger import Merge
from merging.pairwise.prepared_maps import PreparedMaps
from merging.report.pair_pictures import CAPTION, draw_alone, draw_pair
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.page import Card, Picture, Table

MOST_CARDS = 60
"""More pairs than these are told in a table: pictures of thousands would make the page too large to open."""

_AS_JUDGED = "The maps are drawn as they were judged."


def pair_cards(merge: Merge, maps: Mapping[str, TbmMap], config: MergeConfig) -> tuple[list[Card], list[Table]]:
    """Return cards of the pairs that tell most, and a table of the others where there are too many."""
    telling = sorted(merge.alignments, key=lambda pair: _telling(merge.alignments[pair]), reverse=True)[:MOST_CARDS]
    # Features are for finding an alignment, and these have been found.
    looks = config.model_copy(update={"method": "correlation"})
    views = PreparedMaps({name: one.grid for name, one in maps.items()}, looks)
    cards = [
        Card(
            title=f"{pair[1]} in {pair[0]}",
            verdict=_verdict(pair, merge),
            good=merge.alignments[pair].accepted and pair not in merge.outvoted,
            reason=_sentence(merge.alignments[pair].reason),
            figures=_figures(merge.alignments[pair]),
            pictures=_pictures(pair, merge, views, looks),
        )
        for pair in merge.alignments
        if pair in set(telling)
    ]
    others = [pair for pair in merge.alignments if pair not in set(telling)]
    return cards, [_table(others, merge)] if others else []


def _telling(found: Alignment) -> tuple[bool, bool, float]:
    return found.accepted, found.ambiguous, found.agreed_wall_m


def _verdict(pair: Pair, merge: Merge) -> str:
    found = merge.alignments[pair]
    if pair in merge.outvoted:
        return "accepted, but outvoted"
    if found.accepted:
        return "accepted"
    if pair in merge.used:
        return "confirmed by others"
    return "ambiguous" if found.ambiguous else "refused"


def _sentence(reason: str) -> str:
    return f"{reason[:1].upper()}{reason[1:]}."


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


def _pictures(pair: Pair, merge: Merge, views: PreparedMaps, config: MergeConfig) -> Sequence[Picture]:
    found, caption = merge.alignments[pair], CAPTION
    if pair in merge.judged_by:
        views, caption = (
            PreparedMaps(dict(zip(pair, merge.judged_by[pair], strict=True)), config),
            f"{CAPTION} {_AS_JUDGED}",
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


def _caption(number: int, other: Alternative) -> str:
    x, y, degrees = format_pose(other.T_target_source)
    where = f"Alternative {number}, at {x} m, {y} m, {degrees}°"
    return f"{where}: confidence {other.confidence:.3f}, {other.agreed_wall_m:.1f} m of wall agree."


def _table(pairs: Sequence[Pair], merge: Merge) -> Table:
    rows = [
        (target, source, _verdict((target, source), merge), format_confidence(found.confidence), found.reason)
        for target, source in pairs
        for found in [merge.alignments[target, source]]
    ]
    return Table("Further pairs", ("target", "source", "", "#confidence", "reason"), rows)
