"""Pictures of the errors of trajectories and maps."""

from dataclasses import dataclass

import numpy as np

from tbmslam.belief.grid import GridGeometry
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.evaluation.map_agreement import Labels
from tbmslam.geometry.se2 import FloatArray
from tbmslam.io.pictures import Picture

# Colours as OpenCV orders them: blue, green, red.
_SAME_FREE, _SAME_OCCUPIED = (255, 255, 255), (0, 0, 0)
_FALSE_WALL, _MISSED_WALL = (40, 40, 230), (230, 120, 20)
_ONLY_MAP, _ONLY_TRUTH, _UNKNOWN = (205, 225, 205), (225, 205, 205), (160, 160, 160)

_GREYS = np.array([225, 250, 130, 225], dtype=np.uint8)  # of the background, by label

_LONGEST_SIDE, _MARGIN, _LEGEND_WIDTH, _LEGEND_HEIGHT = 1600, 20, 300, 46


@dataclass(frozen=True)
class Backdrop:
    """Walls behind a trajectory."""

    labels: Labels
    """Label of each cell (rows, cols)."""
    geometry: GridGeometry
    """Geometry of the cells in the trajectory's frame."""


def draw_trajectory_errors(points: FloatArray, errors: FloatArray, backdrop: Backdrop | None = None) -> Picture:
    """Draw positions (N, 2) coloured by their errors (N,) [m], from dark blue for 0 to dark red for the largest.

    Returns a colour picture, y up, with a scale beneath. The backdrop is drawn in light grey.
    """
    import cv2  # noqa: PLC0415  measuring needs no pictures

    if not len(points) or len(points) != len(errors):
        raise ValueError(f"points and errors must agree in length above 0, got {len(points)}, {len(errors)}")
    low, high = points.min(axis=0), points.max(axis=0)
    if backdrop is not None:
        min_x, min_y, max_x, max_y = backdrop.geometry.bounds()
        low, high = np.minimum(low, (min_x, min_y)), np.maximum(high, (max_x, max_y))
    scale = (_LONGEST_SIDE - 2 * _MARGIN) / max(float((high - low).max()), 1.0)  # [pixels/m]
    width, height = (int(side) + 2 * _MARGIN for side in np.ceil((high - low) * scale))
    width = max(width, _LEGEND_WIDTH + 2 * _MARGIN)
    picture = np.full((height, width, 3), 255, dtype=np.uint8)
    corner = np.array([low[0], high[1]]) - np.array([_MARGIN, -_MARGIN]) / scale  # of the picture, top left [m]
    if backdrop is not None:
        _draw_backdrop(picture, backdrop, corner, scale)
    largest = float(errors.max())
    shades = np.rint(255.0 * errors / largest if largest > 0.0 else np.zeros(len(errors))).astype(np.uint8)
    colours = cv2.applyColorMap(shades[:, None], cv2.COLORMAP_TURBO)[:, 0].tolist()
    pixels = np.rint((points - corner) * (scale, -scale)).astype(int)
    for index in np.argsort(errors, kind="stable"):  # the largest errors on top
        centre = (int(pixels[index, 0]), int(pixels[index, 1]))
        cv2.circle(picture, centre, 3, colours[index], thickness=-1, lineType=cv2.LINE_AA)
    return np.vstack((picture, _colour_scale(width, largest)))


def draw_map_errors(labels: Labels, truth: Labels) -> Picture:
    """Draw the differences of a map and the truth (rows, cols), one pixel for each cell, y up.

    White and black are free and occupied to both, red is a wall that is not there, blue a wall that the map misses,
    light green (blue) known to the map (the truth) alone, grey unknown to both.
    """
    if labels.shape != truth.shape:
        raise ValueError(f"labels and truth must have the same shape, got {labels.shape} and {truth.shape}")
    picture = np.empty((*labels.shape, 3), dtype=np.uint8)
    picture[...] = _UNKNOWN
    for label, true, colour in (
        (FREE, FREE, _SAME_FREE),
        (OCCUPIED, OCCUPIED, _SAME_OCCUPIED),
        (OCCUPIED, FREE, _FALSE_WALL),
        (FREE, OCCUPIED, _MISSED_WALL),
    ):
        picture[(labels == label) & (truth == true)] = colour
    picture[(labels != UNKNOWN) & (truth == UNKNOWN)] = _ONLY_MAP
    picture[(labels == UNKNOWN) & (truth != UNKNOWN)] = _ONLY_TRUTH
    return np.ascontiguousarray(picture[::-1])


def _draw_backdrop(picture: Picture, backdrop: Backdrop, corner: FloatArray, scale: float) -> None:
    """Draw the walls in the background, each pixel by its cell."""
    labels, geometry = backdrop.labels, backdrop.geometry
    rows, cols = picture.shape[:2]
    x = corner[0] + (np.arange(cols) + 0.5) / scale
    y = corner[1] - (np.arange(rows) + 0.5) / scale
    cell_cols = np.floor((x - geometry.origin_x) / geometry.resolution).astype(int)
    cell_rows = np.floor((y - geometry.origin_y) / geometry.resolution).astype(int)
    inside_cols = np.flatnonzero((cell_cols >= 0) & (cell_cols < geometry.cols))
    inside_rows = np.flatnonzero((cell_rows >= 0) & (cell_rows < geometry.rows))
    seen = labels[np.ix_(cell_rows[inside_rows], cell_cols[inside_cols])]
    picture[np.ix_(inside_rows, inside_cols)] = _GREYS[seen][..., None]
    # A wall may be thinner than a pixel, so every occupied cell marks its pixel.
    wall_x, wall_y = geometry.centres_of(*np.nonzero(labels == OCCUPIED)).T
    picture[((corner[1] - wall_y) * scale).astype(int), ((wall_x - corner[0]) * scale).astype(int)] = _GREYS[OCCUPIED]


def _colour_scale(width: int, largest: float) -> Picture:
    """Return the legend of the colours up to the largest error [m]."""
    import cv2  # noqa: PLC0415  measuring needs no pictures

    strip = np.full((_LEGEND_HEIGHT, width, 3), 255, dtype=np.uint8)
    ramp = np.linspace(0, 255, _LEGEND_WIDTH).astype(np.uint8)[None].repeat(12, axis=0)
    strip[4:16, _MARGIN : _MARGIN + _LEGEND_WIDTH] = cv2.applyColorMap(ramp, cv2.COLORMAP_TURBO)
    for text, left in (("0", _MARGIN), (f"{largest:.3g} m", _MARGIN + _LEGEND_WIDTH - 60)):
        cv2.putText(strip, text, (left, 36), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), lineType=cv2.LINE_AA)
    return strip
