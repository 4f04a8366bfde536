"""The report of a merge as JSON and as pictures."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from merging.config import MergeConfig
from merging.fusion import Fusion, conflict_places, offset_in, warp
from merging.merger import Merge
from merging.registration.features import Channels, Image, flipped
from merging.report.layers import colours_of, without_rounding
from merging.report.page import merge_page
from tbmslam.belief.grid import walls_and_free
from tbmslam.io.atomic_file import write_bytes
from tbmslam.io.pictures import encode_png
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.page import RunInfo, downloads

_UNKNOWN_GREY = 205
_BAND = 256  # rows that are drawn at once, to limit the memory
_AREAS_TOLD = {
    "known_m2": "known in the merged map",
    "seen_m2": "seen by any map",
    "seen_by_several_m2": "seen by several maps",
    "conflict_m2": "contradicted, weighed by the mass of the conflict",
}


def write_report(
    folder: Path, merge: Merge, maps: Mapping[str, TbmMap], config: MergeConfig, run_info: RunInfo | None = None
) -> None:
    """Write report.json, report.html and, for merged maps, overlay.png and contradictions.png; replace older files.

    Conflict by the rounding of walls to cells is not shown; see `merging.report.layers.without_rounding`.
    """
    maps = {**maps, **merge.deformed}
    merge = without_rounding(merge, maps, config.reliability)
    files = {"report.json": (json.dumps(as_json(merge, config), indent=2, allow_nan=False) + "\n").encode()}
    areas: dict[str, float] = {}
    if merge.fusion is not None:
        files["overlay.png"] = _png_of_rgb(draw_overlay(merge, maps, merge.fusion))
        files["contradictions.png"] = _png_of_rgb(draw_conflict(merge.fusion))
        areas = {_AREAS_TOLD[name]: area for name, area in _areas(merge.fusion).items()}
    for name, content in files.items():
        write_bytes(folder / name, content)
    page = merge_page(merge, maps, config, areas, run_info or RunInfo())
    page = replace(page, downloads={"": downloads(folder, folder)})
    write_bytes(folder / "report.html", page.to_html().encode("utf-8", "backslashreplace"))
    for name in {"overlay.png", "contradictions.png"} - files.keys():
        (folder / name).unlink(missing_ok=True)  # of an older merge


def as_json(merge: Merge, config: MergeConfig) -> dict[str, object]:
    """Return the report for JSON; poses are [x m, y m, theta rad]."""
    merged_maps: dict[str, object] = {
        name: {"merged": True, "T_merged_map": list(pose)} for name, pose in merge.poses.items()
    }
    left_out = {
        name: {"merged": False, "T_merged_map": None, "reason": reason} for name, reason in merge.left_out.items()
    }
    return {
        "merged": merge.merged is not None,
        "frame": next(iter(merge.poses), None),
        "maps": merged_maps | left_out,
        "pairs": [
            {
                "target": target,
                "source": source,
                **alignment.as_json(),
                "used": (target, source) in merge.used,
                "outvoted": (target, source) in merge.outvoted,
            }
            for (target, source), alignment in merge.alignments.items()
        ],
        "fusion": None if merge.fusion is None else {"rule": merge.fusion.rule, **_areas(merge.fusion)},
        "refinement": _refinement(merge),
        "conflict_places": [] if merge.fusion is None else [asdict(place) for place in conflict_places(merge.fusion)],
        "config": config.model_dump(mode="json"),
    }


def draw_overlay(merge: Merge, maps: Mapping[str, TbmMap], fusion: Fusion) -> Image:
    """Draw every map's walls in its own colour (rows, cols, 3) as RGB; coinciding walls are dark."""
    canvas = fusion.grid.geometry
    picture = np.full((canvas.rows, canvas.cols, 3), _UNKNOWN_GREY, dtype=np.uint8)
    picture[fusion.seen_by > 0] = 255
    for name, colour in colours_of(list(merge.poses)).items():
        layer = warp(*merge.laid(name, maps), canvas)
        row, col = offset_in(canvas, layer.geometry)
        window = picture[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        walls, _ = walls_and_free(layer)
        window[walls] = window[walls].astype(np.uint16) * np.array(colour, dtype=np.uint16) // 255
    return np.asarray(flipped(picture), dtype=np.uint8)


def draw_conflict(fusion: Fusion) -> Image:
    """Draw the contradictions (rows, cols, 3) as RGB: red on a faint picture of the merged map."""
    rows, cols = fusion.conflict.shape
    picture = np.empty((rows, cols, 3), dtype=np.uint8)
    for first in range(0, rows, _BAND):
        last = min(first + _BAND, rows)
        faint = 191 + Channels.from_grid(fusion.grid.part(first, last, 0, cols)).pignistic.astype(np.float64) / 4.0
        strength = np.asarray(flipped(fusion.conflict[first:last]), dtype=np.float64)
        red, rest = faint * (1.0 - strength) + 200.0 * strength, faint * (1.0 - strength)
        picture[rows - last : rows - first] = np.rint(np.dstack((red, rest, rest)))
    return picture


def _refinement(merge: Merge) -> dict[str, object] | None:
    """Return whether the drives were optimised jointly, and which maps were deformed; None without a merged map."""
    if merge.merged is None:
        return None
    deformed = list(merge.deformed)
    if merge.joint is None:
        return {"kind": "rigid", "bent": deformed}
    return {"kind": "joint", "closures": merge.joint.closures, "moved_m": merge.joint.moved_m, "bent": deformed}


def _areas(fusion: Fusion) -> dict[str, float]:
    cell_m2 = fusion.grid.geometry.resolution**2
    return {
        "known_m2": fusion.grid.known_m2(),
        "seen_m2": float((fusion.seen_by > 0).sum() * cell_m2),
        "seen_by_several_m2": float((fusion.seen_by > 1).sum() * cell_m2),
        "conflict_m2": fusion.conflict_m2(),
    }


def _png_of_rgb(picture: npt.NDArray[np.uint8]) -> bytes:
    return encode_png(np.ascontiguousarray(picture[..., ::-1]))
