"""The report of a merge as a page: the map, the confidence of the poses, and the evidence for every pair."""

from collections.abc import Mapping

from merging.alignment import format_confidence, format_pose
from merging.config import MergeConfig
from merging.fusion import conflict_places
from merging.merger import Merge
from merging.report.layers import colours_of, merged_sheet, single_sheet
from merging.report.pair_cards import hypothesis_used, pair_cards
from merging.report.provenance import warnings_of
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.maps_page import joined_warnings
from tbmslam.report.page import Page, RunInfo, Table, versions
from tbmslam.report.sheet import Sheet

_DOUBTFUL = 0.9
_LARGE_CONFLICT_M2 = 0.25
_MOST_SHEETS = 30  # number of maps shown that were not merged; a page with hundreds would be too large to open


def merge_page(
    merge: Merge, maps: Mapping[str, TbmMap], config: MergeConfig, areas_m2: Mapping[str, float], run_info: RunInfo
) -> Page:
    """Return the page of a merge, with areas to show by name [m^2] and the run of the program."""
    cards, more = pair_cards(merge, maps, config)
    areas = [Table("Areas", ("area", "#m²"), [(name, f"{area:.1f}") for name, area in areas_m2.items()])]
    return Page(
        title="Merge of " + (", ".join(maps) if len(maps) <= 3 else f"{len(maps)} maps"),
        verdict=_verdict(merge),
        good=merge.merged is not None and not merge.left_out,
        figures=_figures(merge, config),
        sheets=_sheets(merge, maps),
        warnings=_warnings(merge, maps, config),
        tables=[_maps_table(merge, config), *more, *(areas if areas_m2 else [])],
        cards=cards,
        cards_title="Pairs",
        cards_note="The pose of each source in its target’s frame. A refused pair joins no maps on its own.",
        seconds=run_info.seconds,
        command=run_info.command,
        versions=versions(),
        config=config.model_dump(mode="json"),
        defaults=MergeConfig().model_dump(mode="json"),
    )


def confidences_of(merge: Merge, config: MergeConfig) -> dict[str, float]:
    """Return the confidence of the pose of each merged map.

    It is the confidence of the weakest pose hypothesis on the best path from the map whose frame the merged map has.
    Confirmation by other paths is not counted, so it is a lower bound.
    """
    sure = dict.fromkeys(merge.poses, 0.0)
    first = next(iter(sure), None)
    if first is None:
        return sure
    sure[first] = 1.0
    used = {pair: hypothesis_used(pair, merge, config).confidence for pair in merge.used}
    for _ in sure:
        for (target, source), through in used.items():
            for here, there in ((target, source), (source, target)):
                sure[there] = max(sure[there], min(sure[here], through))
    return sure


def _verdict(merge: Merge) -> str:
    if merge.merged is None:
        return "No two maps could be merged."
    return f"{len(merge.poses)} of {len(merge.poses) + len(merge.left_out)} maps were merged."


def _figures(merge: Merge, config: MergeConfig) -> dict[str, str]:
    accepted = sum(found.accepted for found in merge.alignments.values())
    figures = {"pairs accepted": f"{accepted} of {len(merge.alignments)}"}
    if merge.fusion is not None:
        figures["least confidence"] = format_confidence(min(confidences_of(merge, config).values()))
        figures["known area"] = f"{merge.fusion.grid.known_m2():.0f} m²"
        figures["contradicted"] = f"{merge.fusion.conflict_m2():.1f} m²"
    return figures


def _sheets(merge: Merge, maps: Mapping[str, TbmMap]) -> list[Sheet]:
    colours = colours_of(list(maps))
    sheets = []
    if merge.merged is not None and merge.fusion is not None:
        sheets.append(merged_sheet(merge, merge.merged, merge.fusion, maps))
    apart = [name for name in merge.left_out if maps[name].grid.is_known().any()]
    return sheets + [single_sheet(name, maps[name], colours[name]) for name in apart[:_MOST_SHEETS]]


def _warnings(merge: Merge, maps: Mapping[str, TbmMap], config: MergeConfig) -> list[str]:
    warnings = [f"{name} was left out: {reason}" for name, reason in merge.left_out.items()]
    warnings += [
        f"{source} in {target} is ambiguous: the maps fit in {len(found.alternatives) + 1} places"
        for (target, source), found in merge.alignments.items()
        if found.ambiguous
    ]
    warnings += [
        f"{source} in {target} was accepted by itself, but contradicts the other alignments and was not used"
        for target, source in merge.outvoted
    ]
    warnings += [
        f"the pose of {name} is not sure: confidence {format_confidence(confidence)}"
        for name, confidence in confidences_of(merge, config).items()
        if confidence < _DOUBTFUL
    ]
    if merge.merged is not None and merge.joint is None:
        warnings.append(
            f"{' and '.join(merge.deformed)} {'was' if len(merge.deformed) == 1 else 'were'} deformed to fit the "
            "other maps; another map may be the distorted one"
            if merge.deformed
            else "the maps were merged rigidly, without joint optimisation: walls of a distorted map are doubled"
        )
    if merge.fusion is not None:
        warnings += [
            f"maps contradict each other over {place.area_m2:.2f} m² near x {place.x:.1f} m, y {place.y:.1f} m"
            for place in conflict_places(merge.fusion)
            if place.conflict_m2 >= _LARGE_CONFLICT_M2
        ]
    return warnings + joined_warnings({name: warnings_of(tbm_map.provenance) for name, tbm_map in maps.items()})


def _maps_table(merge: Merge, config: MergeConfig) -> Table:
    sure = confidences_of(merge, config)
    rows = [
        (name, *format_pose(pose), format_confidence(sure[name]), _role(merge, name))
        for name, pose in merge.poses.items()
    ]
    rows += [(name, *format_pose(None), "–", f"left out: {reason}") for name, reason in merge.left_out.items()]
    marks = [f"rgb{colour}" for colour in colours_of(list(merge.poses)).values()]
    heads = ("map", "#x [m]", "#y [m]", "#θ [°]", "#confidence", "")
    note = "Poses in the frame of the merged map. The confidence of the weakest alignment on the best path is shown."
    return Table("Maps", heads, rows, note, marks)


def _role(merge: Merge, name: str) -> str:
    """Return the role of a merged map; joint optimisation moves the first map, too, by some centimetres."""
    return "the others were placed in its frame" if name == next(iter(merge.poses)) else "merged"
