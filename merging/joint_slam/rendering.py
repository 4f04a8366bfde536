"""Grids rendered again from keyframes, the way the map they belong to says that it was rendered."""

import math
from collections.abc import Mapping, Sequence

from pydantic import ValidationError

from tbmslam.belief.grid import TbmGrid
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import MapConfig, render
from tbmslam.map.tbm_map import TbmMap


def redraw(drives: Sequence[Keyframes], one: TbmMap, max_range: float = math.inf) -> TbmGrid:
    """Return the grid of some keyframes, rendered as a map says that it was, with cells of its size.

    A hit beyond `max_range` [m], or beyond the map's own limit, only clears the way up to it.
    """
    how = _map_config(one)
    insertion = how.insertion.model_copy(update={"max_range": min(max_range, how.insertion.max_range)})
    return render(drives, how.model_copy(update={"resolution": one.grid.geometry.resolution, "insertion": insertion}))


def drawn_alike(maps: Sequence[TbmMap]) -> bool:
    """Tell whether maps say that they were rendered in one way, in cells of one size."""
    ways = [(_map_config(one), one.grid.geometry.resolution) for one in maps]
    return all(way == ways[0] for way in ways)


def _map_config(one: TbmMap) -> MapConfig:
    """Return how a map says that it was rendered; the default where it does not say."""
    settings = one.provenance.get("config")
    try:
        return MapConfig.model_validate(settings["map"] if isinstance(settings, Mapping) else {})
    except (KeyError, ValidationError):
        return MapConfig()
