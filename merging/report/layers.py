"""The layers of a merged map: walls of each map, overlap, contradictions and drives."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from merging.fusion import Fusion, offset_in, warp
from merging.merger import Merge
from merging.report.provenance import incidents_of
from tbmslam.belief.grid import TbmGrid, walls_and_free
from tbmslam.belief.tiled_masses import sparse_zeros
from tbmslam.map.drive import Drive
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.map_layers import ROBOT_COLOURS, drive_layers, for_display, incident_layer, map_layers
from tbmslam.report.sheet import Colour, Levels, Marks, Palette, Raster, Sheet, Switch, drive_tracks, levels_of

_ONE_WALL, _ONE_WALL_M = 2, 0.2
"""Two walls at most this number of cells and this distance apart are one wall (one cell at least): cells round by half
a cell, and noise moves hits to the next cell. A door is wider than twice this distance."""


def without_rounding(merge: Merge, maps: Mapping[str, TbmMap], reliability: Mapping[str, float]) -> Merge:
    """Return a merge that keeps conflict only at walls where another map is free within two cells all around.

    Other conflict is caused by rounding and by beams that graze a wall. The fused masses do not change. Maps of
    reliability 0 are ignored, since they do not contribute to the conflict.
    """
    if merge.fusion is None:
        return merge
    canvas = merge.fusion.grid.geometry
    cells = min(_ONE_WALL, max(1, round(_ONE_WALL_M / canvas.resolution)))
    across = np.arange(-cells, cells + 1)
    reach = (np.hypot(across[:, None], across) <= cells).astype(np.uint8)
    wall, denied = np.zeros((2, canvas.rows, canvas.cols), dtype=np.bool_)
    for name in (name for name in merge.poses if reliability.get(name, 1.0) > 0.0):
        layer = warp(*merge.laid(name, maps), canvas)
        row, col = offset_in(canvas, layer.geometry)
        window = np.s_[row : row + layer.geometry.rows, col : col + layer.geometry.cols]
        walls, free = walls_and_free(layer)
        wall[window] |= walls
        within = cv2.erode(free.view(np.uint8), reach, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        denied[window] |= within > 0
    conflict = sparse_zeros((canvas.rows, canvas.cols), np.float32)
    np.copyto(conflict, merge.fusion.conflict, where=wall & denied)
    return replace(merge, fusion=replace(merge.fusion, conflict=conflict))


_CONTRADICTION = Palette.ramp((255, 244, 240), (240, 110, 80), (170, 0, 20), alphas=(0,))
_MOST_SEEN = 20
_SEEN_BY = Palette(
    tuple((int(238 - 7 * n), int(232 - 11 * n), int(250 - 4 * n)) for n in range(_MOST_SEEN + 1)), alphas=(0, 0)
)
_LEAST_WALL, _LEAST_FREE = 0.1, 0.3
"""Least shares of wall and of free cells with which a shown cell, made of several cells, is drawn as wall or free."""
_EVIDENCE, _ROBOTS = "Evidence", "Robots"


def colours_of(names: list[str]) -> dict[str, Colour]:
    """Return the colour of each map."""
    return {name: ROBOT_COLOURS[index % len(ROBOT_COLOURS)] for index, name in enumerate(names)}


def merged_sheet(merge: Merge, merged: TbmMap, fusion: Fusion, maps: Mapping[str, TbmMap]) -> Sheet:
    """Return the sheet of the merged map with all layers."""
    colours = colours_of(list(merge.poses))
    robots = [_walls(name, _laid(merge, maps, name), colours[name]) for name in merge.poses]
    owners = [name for name in merge.poses for _ in maps[name].drives]
    drives = [_named(drive, name, maps) for drive, name in zip(merged.drives, owners, strict=True)]
    owned = [colours[name] for name in owners]
    lines = drive_layers(drives, owned, _ROBOTS, merged.grid.geometry.resolution)
    incidents = _incident_layers(drives, [known for name in merge.poses for known in incidents_of(maps[name])])
    layers: tuple[Raster | Marks, ...]
    layers = (*map_layers(fusion.grid), *robots, *lines, *incidents, *_evidence(fusion), *_links(merge, merged))
    note = "The colours of several robots mix to a dark colour where their walls coincide."
    return Sheet("Merged map", layers, note, drive_tracks(drives, owned))


def single_sheet(name: str, tbm_map: TbmMap, colour: Colour) -> Sheet:
    """Return the sheet of a map that was not merged, in its own frame."""
    colours = [colour] * len(tbm_map.drives)
    drives = drive_layers(tbm_map.drives, colours, _ROBOTS, tbm_map.grid.geometry.resolution)
    incidents = _incident_layers(tbm_map.drives, incidents_of(tbm_map))
    rasters = map_layers(tbm_map.grid.cropped_to_known())
    return Sheet(name, (*rasters, *drives, *incidents), tracks=drive_tracks(tbm_map.drives, colours))


def _incident_layers(drives: Sequence[Drive], incidents: Sequence[object]) -> list[Marks]:
    return [
        mark for drive, known in zip(drives, incidents, strict=True) for mark in incident_layer(drive, known, _ROBOTS)
    ]


def _laid(merge: Merge, maps: Mapping[str, TbmMap], name: str) -> TbmGrid:
    """Return a map's grid in the merged frame."""
    assert merge.fusion is not None  # noqa: S101  # only merged maps have this sheet
    return warp(*merge.laid(name, maps), merge.fusion.grid.geometry)


def _named(drive: Drive, name: str, maps: Mapping[str, TbmMap]) -> Drive:
    """Return a drive under its map's name if it is the only drive of the map, so that both share a row of switches."""
    if len(maps[name].drives) > 1:
        return drive
    return replace(drive, name=name)


def _walls(name: str, grid: TbmGrid, colour: Colour) -> Raster:
    """Draw a map in one colour: its walls, and its free space as a tint."""
    both = walls_and_free(grid)
    geometry, shares = for_display(
        grid.geometry, lambda first, last: np.dstack([cells[first:last] for cells in both]).astype(np.float32)
    )
    levels: Levels = np.where(
        shares[..., 0] >= _LEAST_WALL, np.uint8(2), (shares[..., 1] >= _LEAST_FREE).astype(np.uint8)
    )
    red, green, blue = colour
    tint = ((red + 255) // 2, (green + 255) // 2, (blue + 255) // 2)
    palette = Palette(((255, 255, 255), tint, colour), alphas=(0, 30))
    switch = Switch(_ROBOTS, name, "map", shown=True, note="walls, and free space as a tint")
    return Raster(switch, geometry, levels, palette)


def _evidence(fusion: Fusion) -> list[Raster]:
    geometry, conflict = for_display(fusion.grid.geometry, lambda first, last: fusion.conflict[first:last])
    _, seen_by = for_display(fusion.grid.geometry, lambda first, last: fusion.seen_by[first:last].astype(np.float32))
    return [
        Raster(
            Switch(_EVIDENCE, "overlap", note="number of maps that saw a cell, if more than one"),
            geometry,
            np.minimum(np.rint(seen_by), _MOST_SEEN).astype(np.uint8),
            _SEEN_BY,
            unit=1.0,
            opacity=0.6,
        ),
        Raster(
            Switch(
                _EVIDENCE, "contradictions", note="contradictions of the maps: walls in the free space of another map"
            ),
            geometry,
            levels_of(conflict),
            _CONTRADICTION,
            unit=0.05,
        ),
    ]


def _links(merge: Merge, merged: TbmMap) -> list[Marks]:
    """Return the loop closures between robots that the joint optimisation used."""
    if merge.joint is None or not merge.joint.closures:
        return []
    ends = merge.joint.links.ends.reshape(-1, 2)
    points = np.array([merged.drives[drive].keyframes.poses[keyframe, :2] for drive, keyframe in ends])
    note = "loop closures between robots; the drives were optimised jointly with them"
    return [Marks(Switch(_EVIDENCE, "loops between robots", note=note), "links", points, (90, 24, 154))]
