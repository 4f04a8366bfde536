"""A picture of a fleet: its maps as a graph, and the merged map of its largest group."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import cv2
import numpy as np

from merging.alignment import Pair
from merging.map_graph.grouping import Group
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import FloatArray
from tbmslam.io.pictures import Picture

_FINER = 2
"""It is drawn so many times as large, and reduced."""
_HEIGHT, _MARGIN = 672, 24
"""Height of both pictures, and the space around them [pixels]."""
_RING, _NODE = 0.32, 0.045
"""Radius of the ring that a group's maps stand on, and of a map, in sides of the group's square."""
_SURE = (0.3, 0.7)
"""Probabilities of being occupied that are drawn white and black."""
_WHITE, _FAINT, _ALONE, _UNSEEN = (255, 255, 255), (232, 232, 232), (150, 150, 150), 226
_COLOURS = (
    (178, 114, 0),
    (0, 94, 213),
    (115, 158, 0),
    (167, 121, 204),
    (0, 159, 230),
    (233, 180, 86),
    (61, 61, 158),
    (128, 128, 0),
)
"""Of groups, blue, green and red; after M. Okabe and K. Ito, "Color universal design", 2008."""


def draw_fleet(
    groups: Sequence[Group], accepted: Collection[Pair], aligned: Collection[Pair], merged: TbmGrid
) -> Picture:
    """Draw maps as dots, those of a group in a ring, and alignments as lines; beside them a merged map.

    Parameters
    ----------
    groups
        The groups, the largest first; maps alone are grey.
    accepted, aligned
        The pairs whose alignment was accepted, and all that were aligned. Accepted ones have their group's colour,
        refused ones are faint.
    merged
        The merged map.
    """
    graph, grid = _graph(groups, set(accepted), aligned), _map(merged)
    return np.hstack([_framed(graph), _framed(grid)])


def _framed(picture: Picture) -> Picture:
    """Return a picture with space around it."""
    framed = cv2.copyMakeBorder(picture, _MARGIN, _MARGIN, _MARGIN, _MARGIN, cv2.BORDER_CONSTANT, value=_WHITE)
    return np.asarray(framed, dtype=np.uint8)


def _graph(groups: Sequence[Group], accepted: set[Pair], aligned: Collection[Pair]) -> Picture:
    across = max(math.ceil(math.sqrt(len(groups))), 1)
    down = max(math.ceil(len(groups) / across), 1)
    side = _HEIGHT / down
    picture = np.full((_HEIGHT * _FINER, round(across * side) * _FINER, 3), 255, dtype=np.uint8)
    places, colours = dict[str, FloatArray](), dict[str, tuple[int, int, int]]()
    for number, group in enumerate(groups):
        middle = (np.array([number % across, number // across]) + 0.5) * side
        colour = _COLOURS[number % len(_COLOURS)] if len(group) > 1 else _ALONE
        for name, place in zip(group.poses, _ring(middle, side * _RING, len(group)), strict=True):
            places[name], colours[name] = place, colour
    for pair in aligned:
        if pair not in accepted:
            _line(picture, places, pair, _FAINT, 1)
    for pair in aligned:
        if pair in accepted:
            _line(picture, places, pair, colours[pair[0]], 2)
    for name, place in places.items():
        for radius, colour in ((1.25 * _NODE, _WHITE), (_NODE, colours[name])):
            cv2.circle(picture, _pixel(place), round(radius * side * _FINER), colour, -1, cv2.LINE_AA)
    return np.asarray(cv2.resize(picture, None, fx=1 / _FINER, fy=1 / _FINER, interpolation=cv2.INTER_AREA), np.uint8)


def _ring(middle: FloatArray, radius: float, count: int) -> Iterator[FloatArray]:
    """Yield the places of so many maps around a middle, the first one above it."""
    for turn in np.arange(count) * (2.0 * math.pi / count):
        yield middle + (radius if count > 1 else 0.0) * np.array([math.sin(turn), -math.cos(turn)])


def _line(
    picture: Picture, places: Mapping[str, FloatArray], pair: Pair, colour: tuple[int, int, int], width: int
) -> None:
    cv2.line(picture, _pixel(places[pair[0]]), _pixel(places[pair[1]]), colour, width * _FINER, cv2.LINE_AA)


def _pixel(place: FloatArray) -> tuple[int, int]:
    return round(float(place[0]) * _FINER), round(float(place[1]) * _FINER)


def _map(grid: TbmGrid) -> Picture:
    """Return a map: walls dark, free space white, what nobody saw grey."""
    known = grid.cropped_to_known(margin=8)
    free = np.clip((_SURE[1] - known.pignistic()) / (_SURE[1] - _SURE[0]), 0.0, 1.0)
    shades = np.where(known.is_known(), 255.0 * free, _UNSEEN).astype(np.uint8)[::-1]
    size = max(round(shades.shape[1] * _HEIGHT / shades.shape[0]), 1), _HEIGHT
    smaller = cv2.resize(np.ascontiguousarray(shades), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(smaller, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
