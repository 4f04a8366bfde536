"""Two maps of a floor whose merged rectangle has an area, to measure costs by area."""

from dataclasses import replace

from datasets.synthetic.map_pairs.pairs import building_of_area, cut_pairs
from merging.fusion import canvas_over, offset_in, window_over
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.map.tbm_map import TbmMap
from tools.map_pairs.known_pair import KnownPair

_FLOOR_SHARES = (0.6, 0.5, 0.45, 0.4, 0.35, 0.3, 0.2)
"""Shares of the canvas of two rotated maps for the floor; the first that fits is used."""


def pair_of_area(area_m2: float, resolution: float) -> KnownPair:
    """Return a pair cut from a building whose merged rectangle has an area, within half a row.

    The target has rows of unknown cells where the maps themselves need less.
    """
    for share in _FLOOR_SHARES:
        known = KnownPair.of(next(cut_pairs(building_of_area(share * area_m2, 1, resolution), 1, [0.5])))
        target, source, motion = known.target.grid, known.source.grid, known.T_target_source
        assert motion is not None  # noqa: S101 - cut pairs overlap
        canvas = canvas_over([target.geometry, window_over(source.geometry, motion, target.geometry)])
        rows = round(area_m2 / (canvas.cols * resolution**2))
        if rows >= canvas.rows:
            return replace(known, target=TbmMap(_on_canvas(target, canvas._replace(rows=rows))))
    raise TbmSlamError(f"two maps of a floor do not fit into {area_m2:g} m² with cells of {resolution:g} m")


def _on_canvas(grid: TbmGrid, canvas: GridGeometry) -> TbmGrid:
    """Return a grid with unknown cells around it."""
    larger, (row, col) = TbmGrid.unknown(canvas), offset_in(canvas, grid.geometry)
    larger.masses[row : row + grid.geometry.rows, col : col + grid.geometry.cols] = grid.masses
    return larger
