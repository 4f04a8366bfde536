"""Pictures of the reproduction's report."""

import io
from collections.abc import Mapping

import numpy as np

from merging.experiments.modifications import MODIFICATIONS, Study
from merging.experiments.published import TABLE_2, table_2
from merging.experiments.significance import half_interval, half_width
from merging.registration.features import Channels
from tbmslam.belief.grid import TbmGrid
from tbmslam.io.pictures import encode_png

COLOURS = {"a": "#0072B2", "b": "#D55E00", "c": "#009E73", "d": "#CC79A7", "e": "#7A7A7A"}
_PAPER_PAIRS = 10
_LITTLE_KNOWN = 217
"""Of 255: cells with more than 85 % of their mass on unknown."""

Window = tuple[slice, slice]
"""Rows and columns of an image."""

Curve = dict[float, tuple[float, float]]
"""Mean and half the interval, by what varies."""


def curves_of(study: Study, keypoints: int, ratio: float) -> tuple[dict[str, Curve], dict[str, Curve]]:
    """Return each modification's curve over the keypoints at one ratio, and over the ratios with so many keypoints."""
    over_keypoints: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    over_ratios: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    for setting, shares in study.shares.items():
        if not np.isfinite(shares).any():
            continue
        point = float(np.nanmean(shares)), half_interval(shares)
        if setting.ratio == ratio:
            over_keypoints[setting.modification][setting.keypoints] = point
        if setting.keypoints == keypoints:
            over_ratios[setting.modification][setting.ratio] = point
    return over_keypoints, over_ratios


def published_curves(keypoints: int, ratio: float) -> tuple[dict[str, Curve], dict[str, Curve]]:
    """Return the paper's curves; intervals follow from its deviations over ten pairs."""
    over_keypoints: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    over_ratios: dict[str, Curve] = {letter: {} for letter in MODIFICATIONS}
    for count, at in TABLE_2:
        for letter, (mean, deviation) in table_2(count, at).values.items():
            point = mean, half_width(deviation, _PAPER_PAIRS)
            if at == ratio:
                over_keypoints[letter][count] = point
            if count == keypoints:
                over_ratios[letter][at] = point
    return over_keypoints, over_ratios


def draw_curves(studies: Mapping[str, Study], keypoints: int, ratio: float) -> bytes:
    """Return figure 3 as a PNG: a line of panels for the paper and for each study, with intervals."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lines = {"the paper": published_curves(keypoints, ratio)}
    lines |= {name: curves_of(study, keypoints, ratio) for name, study in studies.items()}
    figure = Figure(figsize=(10.0, 3.0 * len(lines)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(lines), 2, squeeze=False)
    for row, (name, both) in enumerate(lines.items()):
        for panel, curves, label in zip(
            panels[row], both, (f"keypoints (ratio {ratio:g})", f"Lowe's ratio ({keypoints} keypoints)"), strict=True
        ):
            for number, (letter, curve) in enumerate(curves.items()):
                at = np.array(sorted(curve))
                means, halves = (np.array([curve[x][k] for x in sorted(curve)]) for k in (0, 1))
                shift = (1.0 + 0.03 * (number - 2)) if "keypoints (" in label else 1.0
                moved = at * shift + (0.0 if "keypoints (" in label else 0.004 * (number - 2))
                panel.errorbar(
                    moved,
                    means,
                    yerr=np.nan_to_num(halves),
                    label=f"{letter}: {MODIFICATIONS[letter]}",
                    color=COLOURS[letter],
                    marker="o",
                    markersize=4,
                    capsize=2,
                    linewidth=1.2,
                )
            panel.set(title=name, xlabel=label, ylabel="share of right matches", ylim=(-0.03, 1.08))
            panel.grid(alpha=0.3)
            if "keypoints (" in label:
                panel.set_xscale("log")
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=len(MODIFICATIONS))
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


def window_of(grid: TbmGrid, margin: int = 10) -> Window:
    """Return the part of a grid's image where much is known: a stray beam makes no part of a picture."""
    known = Channels.from_grid(grid).unknown < _LITTLE_KNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(None), slice(None)
    first_row, first_col = max(int(rows[0]) - margin, 0), max(int(cols[0]) - margin, 0)
    return slice(first_row, int(rows[-1]) + margin), slice(first_col, int(cols[-1]) + margin)


def draw_grid(grid: TbmGrid, window: Window) -> bytes:
    """Return a grid's pignistic picture as a PNG: free white, occupied black, unknown grey."""
    return encode_png(Channels.from_grid(grid).pignistic[window])


def draw_channels(grid: TbmGrid) -> list[bytes]:
    """Return figure 1 as PNGs: the pignistic picture and the masses on occupied, free and unknown."""
    channels, window = Channels.from_grid(grid), window_of(grid)
    return [encode_png(i[window]) for i in (channels.pignistic, channels.occupied, channels.free, channels.unknown)]
