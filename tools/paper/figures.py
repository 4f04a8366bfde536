"""The figures of the report on the paper's experiments."""

import io
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from merging.registration.features import Channels, Image
from tbmslam.belief.grid import TbmGrid
from tbmslam.io.pictures import encode_png
from tbmslam.report.page import Picture
from tools.paper.detectors import AS_PROGRAMMED, AS_WRITTEN, MODIFICATIONS, Setting, Study
from tools.paper.experiments import PaperResults, PaperSettings
from tools.paper.map_pair import MapPair
from tools.paper.published import LEVEL, TABLE_2, half_interval, half_width

COLOURS = {"a": "#0072B2", "b": "#D55E00", "c": "#009E73", "d": "#CC79A7", "e": "#7A7A7A"}
_PAPER_PAIRS = 10
_LITTLE_KNOWN = 217  # grey value [of 255] of cells with more than 85 % of their mass on unknown
_MARGIN = 10  # cells around the known ones in a picture

Curve = dict[float, tuple[float, float]]
"""Mean and half of its interval by keypoints or ratio."""


def pictures_of(
    pairs: Sequence[MapPair], results: PaperResults, settings: PaperSettings
) -> dict[str, Sequence[Picture]]:
    """Return all figures by their names in the template."""
    grids = {pair.target_name: pair.target for pair in pairs} | {pair.source_name: pair.source for pair in pairs}
    halves = results.halves
    parts = {"a: the map": halves.original, "b: left part": halves.left, "c: right part": halves.right}
    merged = {"a: the first map": pairs[0].target, "b: the second map": pairs[0].source}
    if results.merged is not None:
        merged["c: merged"] = results.merged
    return {
        "map_pictures": [*_channel_pictures(next(iter(grids.values()))), *(_drawn(*item) for item in grids.items())],
        "curve_pictures": [_curve_picture(results, settings)],
        "halves_pictures": [
            _drawn(name, grid, window=_window_of(halves.original)) for name, grid in {**parts, **halves.fused()}.items()
        ],
        "merged_pictures": [_drawn(*item) for item in merged.items()],
    }


def _window_of(grid: TbmGrid) -> tuple[slice, slice]:
    """Return the part of a grid's image with many known cells, without single beams."""
    known = Channels.from_grid(grid).unknown < _LITTLE_KNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(None), slice(None)
    first_row, first_col = max(int(rows[0]) - _MARGIN, 0), max(int(cols[0]) - _MARGIN, 0)
    return slice(first_row, int(rows[-1]) + _MARGIN), slice(first_col, int(cols[-1]) + _MARGIN)


def _drawn(name: str, grid: TbmGrid, window: tuple[slice, slice] | None = None) -> Picture:
    """Return a grid's pignistic picture: free white, occupied black, unknown grey."""
    return Picture(encode_png(Channels.from_grid(grid).pignistic[window or _window_of(grid)]), name)


def _channel_pictures(grid: TbmGrid) -> list[Picture]:
    """Return figure 1: the pignistic picture and the masses on occupied, free and unknown."""
    channels, window = Channels.from_grid(grid), _window_of(grid)
    named: dict[str, Image] = {
        "a: pignistic": channels.pignistic,
        "b: mass on occupied": channels.occupied,
        "c: mass on free": channels.free,
        "d: mass on unknown": channels.unknown,
    }
    return [Picture(encode_png(image[window]), name) for name, image in named.items()]


def _curve_picture(results: PaperResults, settings: PaperSettings) -> Picture:
    """Return figure 3."""
    points = {"the paper": _published_points()} | {
        f"as {name}": _measured_points(results.studies[variant])
        for name, variant in (
            ("written: 128 bits, unknown as it is", AS_WRITTEN),
            ("programmed: 256 bits, unknown inverted", AS_PROGRAMMED),
        )
    }
    caption = (
        f"Share of right matches over the number of keypoints (left) and Lowe's ratio (right), with {LEVEL:g} "
        "intervals of the mean by Student's t; the paper's from its deviations over ten pairs. A curve without points "
        "matched nothing."
    )
    return Picture(_draw_curves(points, settings.default_keypoints, settings.default_ratio), caption)


_Point = tuple[Setting, tuple[float, float]]


def _measured_points(study: Study) -> list[_Point]:
    """Return mean and half of its interval for every setting with matches."""
    return [
        (setting, (float(np.nanmean(shares)), half_interval(shares)))
        for setting, shares in study.shares.items()
        if np.isfinite(shares).any()
    ]


def _published_points() -> list[_Point]:
    """Return the paper's points; intervals follow from its deviations over ten pairs."""
    return [
        (Setting(count, ratio, letter), (mean, half_width(deviation, _PAPER_PAIRS)))
        for (count, ratio), row in TABLE_2.items()
        for letter, (mean, deviation) in row.values.items()
    ]


def _curves_of(points: Iterable[_Point], keypoints: int, ratio: float) -> tuple[dict[str, Curve], dict[str, Curve]]:
    """Return the curves of each modification over the keypoints at one ratio, and over the ratios at one number."""
    over_keypoints: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    over_ratios: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    for setting, point in points:
        if setting.ratio == ratio:
            over_keypoints[setting.modification][setting.keypoints] = point
        if setting.keypoints == keypoints:
            over_ratios[setting.modification][setting.ratio] = point
    return over_keypoints, over_ratios


def _draw_curves(points: Mapping[str, Sequence[_Point]], keypoints: int, ratio: float) -> bytes:
    """Return a PNG: a line of panels for the paper and for each study, with intervals."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.0 * len(points)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(points), 2, squeeze=False)
    labels = f"keypoints (ratio {ratio:g})", f"Lowe's ratio ({keypoints} keypoints)"
    for row, (name, found) in enumerate(points.items()):
        for column, curves in enumerate(_curves_of(found, keypoints, ratio)):
            panel = panels[row][column]
            for number, (letter, curve) in enumerate(curves.items(), -2):
                at = np.array(sorted(curve))
                means, halves = (np.array([curve[x][k] for x in sorted(curve)]) for k in (0, 1))
                panel.errorbar(
                    at * (1.0 + 0.03 * number) if column == 0 else at + 0.004 * number,
                    means,
                    yerr=np.nan_to_num(halves),
                    label=f"{letter}: {MODIFICATIONS[letter]}",
                    color=COLOURS[letter],
                    marker="o",
                    markersize=4,
                    capsize=2,
                    linewidth=1.2,
                )
            panel.set(title=name, xlabel=labels[column], ylabel="share of right matches", ylim=(-0.03, 1.08))
            panel.grid(alpha=0.3)
            if column == 0:
                panel.set_xscale("log")
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=len(MODIFICATIONS))
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()
