"""Every pair of maps as a card: the decision, its reason, and pictures of the walls."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from merging.alignment import Alignment, Pair, PoseHypothesis, format_confidence, format_covariance, format_pose
from merging.config import MergeConfig
from merging.config.registration import VerificationConfig
from merging.merger import Merge
from merging.pairwise import PreparedMaps
from merging.walls import BoolArray, WallMap
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.grids.walls import FACING
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.page import Card, Picture, Table
from tbmslam.report.sheet import Levels, Palette

_NEITHER, _ONE, _BOTH, _TARGET, _SOURCE, _AGREED, _CONTRADICTED = range(7)
_PALETTE = Palette(
    ((248, 249, 251), (232, 236, 241), (214, 224, 236), (28, 94, 170), (222, 130, 20), (16, 138, 76), (206, 22, 28))
)
CAPTION = (
    "Walls of {target} are blue, of {source} orange. Green walls agree, red walls lie in the other map's free space. "
    "The darker ground is known to both maps."
)
_PIXELS_ALONG = 520
_MARGIN_M = 0.5


@dataclass(frozen=True)
class _Canvas:
    """Pixels over a rectangle; row 0 has the smallest y."""

    left: float
    bottom: float
    step: float
    rows: int
    cols: int

    @classmethod
    def over(cls, points: FloatArray, least_step: float) -> "_Canvas":
        low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
        step = max(float((high - low).max()) / _PIXELS_ALONG, least_step)
        cols, rows = np.ceil((high - low) / step).astype(int)
        return cls(float(low[0]), float(low[1]), step, int(rows), int(cols))

    def centres(self) -> FloatArray:
        """Return the centres (rows * cols, 2) of all pixels."""
        x = self.left + (np.arange(self.cols) + 0.5) * self.step
        y = self.bottom + (np.arange(self.rows) + 0.5) * self.step
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def draw(self, picture: Levels, points: FloatArray, level: int) -> None:
        """Paint the pixels that hold points."""
        cols, rows = ((points - (self.left, self.bottom)) / self.step).astype(int).T
        picture[rows, cols] = level


def draw_pair(target: WallMap, source: WallMap, T_target_source: SE2, config: VerificationConfig) -> bytes:
    """Return a PNG of the target's walls and the transformed walls of the source."""
    moved = T_target_source.apply(source.points)
    canvas = _Canvas.over(
        np.vstack((_corners(target, SE2.identity()), _corners(source, T_target_source))),
        max(target.geometry.resolution, source.geometry.resolution),
    )
    centres = canvas.centres()
    known = _is_known(target, centres).astype(int) + _is_known(source, T_target_source.inverse().apply(centres))
    picture = np.choose(known, (_NEITHER, _ONE, _BOTH)).astype(np.uint8).reshape(canvas.rows, canvas.cols)
    forth = _compared(source, target, T_target_source, config)
    back = _compared(target, source, T_target_source.inverse(), config)
    canvas.draw(picture, target.points, _TARGET)
    canvas.draw(picture, moved, _SOURCE)
    for which, level in ((0, _AGREED), (1, _CONTRADICTED)):
        canvas.draw(picture, target.points[back[which]], level)
        canvas.draw(picture, moved[forth[which]], level)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def draw_alone(structure: WallMap, level: int = _TARGET) -> bytes:
    """Return a PNG of the walls of one map."""
    canvas = _Canvas.over(_corners(structure, SE2.identity()), structure.geometry.resolution)
    known = _is_known(structure, canvas.centres())
    picture = np.where(known, np.uint8(_ONE), np.uint8(_NEITHER)).reshape(canvas.rows, canvas.cols)
    canvas.draw(picture, structure.points, level)
    return _PALETTE.png(np.ascontiguousarray(picture[::-1]))


def _corners(structure: WallMap, T_canvas_map: SE2) -> FloatArray:
    """Return the corners (4, 2) of the known area of a map."""
    g = structure.geometry
    rows, cols = (np.flatnonzero(structure.states.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows = cols = np.zeros(1, dtype=int)
    x = g.origin_x + np.array([cols[0], cols[-1] + 1]) * g.resolution
    y = g.origin_y + np.array([rows[0], rows[-1] + 1]) * g.resolution
    return T_canvas_map.apply([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])


def _is_known(structure: WallMap, points: FloatArray) -> BoolArray:
    rows, cols, inside = structure.geometry.cells_at(points)
    return np.asarray(inside & (structure.states[rows, cols] > 0))


def _compared(
    moving: WallMap, fixed: WallMap, T_fixed_moving: SE2, config: VerificationConfig
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return which walls (N,) agree with the other map, and which contradict it; see `tbmslam.map.walls.compare`."""
    if not len(fixed.points) or not len(moving.points):
        nothing = np.zeros(len(moving.points), dtype=bool)
        return nothing, nothing
    rows, cols, inside = fixed.geometry.cells_at(T_fixed_moving.apply(moving.points))
    distances, nearest = fixed.distances_m[rows, cols], fixed.nearest[rows, cols]
    facing = (SE2(0.0, 0.0, T_fixed_moving.theta).apply(moving.normals) * fixed.normals[nearest]).sum(axis=1)
    alike = (facing >= FACING) | ((moving.two_sided | fixed.two_sided[nearest]) & (facing <= -FACING))
    agreed = inside & alike & (distances <= config.agreement_distance_m)
    return agreed, inside & (fixed.states[rows, cols] == 1) & (distances > config.conflict_distance_m)


MOST_CARDS = 60
"""Further pairs are listed in a table: pictures of thousands would make the page too large to open."""

_EVIDENCE_GRIDS = "The picture shows the deformed or short-range maps that were compared."


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
            good=merge.alignments[pair].accepted and pair not in merge.outvoted,
            reason=f"{merge.alignments[pair].reason[:1].upper()}{merge.alignments[pair].reason[1:]}.",
            figures=_figures(merge.alignments[pair]),
            copied=_pose_words(merge.alignments[pair]),
            pictures=_pictures(pair, merge, views, walls),
        )
        for pair in merge.alignments
        if pair in important
    ]
    others = [pair for pair in merge.alignments if pair not in important]
    return cards, [_table(others, merge)] if others else []


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


def _pose_words(found: Alignment) -> str:
    """Return the pose as the argument X Y DEG of `--pose`; empty if it is unknown."""
    if found.T_target_source is None:
        return ""
    x, y, theta = found.T_target_source
    return f"{x:.4f} {y:.4f} {math.degrees(theta):.3f}"


def _pictures(pair: Pair, merge: Merge, views: PreparedMaps, config: MergeConfig) -> Sequence[Picture]:
    found, caption = merge.alignments[pair], CAPTION
    if pair in merge.evidence_grids:
        views, caption = (
            PreparedMaps(dict(zip(pair, merge.evidence_grids[pair], strict=True)), config),
            f"{CAPTION} {_EVIDENCE_GRIDS}",
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
