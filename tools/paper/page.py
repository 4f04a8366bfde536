"""The page of the paper's experiments, and its figures."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.experiments.detectors import MODIFICATIONS, Study
from merging.experiments.published import TABLE_2, half_interval, half_width, table_2
from merging.registration.features import Channels
from tbmslam.belief.grid import TbmGrid
from tbmslam.io.pictures import encode_png
from tbmslam.report.page import Picture, Table, render

COLOURS = {"a": "#0072B2", "b": "#D55E00", "c": "#009E73", "d": "#CC79A7", "e": "#7A7A7A"}
_PAPER_PAIRS = 10
_LITTLE_KNOWN = 217
"""Grey value [of 255] of cells with more than 85 % of their mass on unknown."""
_MARGIN = 10
"""Cells around the known ones in a picture."""

Window = tuple[slice, slice]
"""Rows and columns of an image."""

Curve = dict[float, tuple[float, float]]
"""Mean and half of its interval by keypoints or ratio."""


def curves_of(study: Study, keypoints: int, ratio: float) -> tuple[dict[str, Curve], dict[str, Curve]]:
    """Return the curves of each modification over the keypoints at one ratio, and over the ratios at one number."""
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


def window_of(grid: TbmGrid) -> Window:
    """Return the part of a grid's image with many known cells, without single beams."""
    known = Channels.from_grid(grid).unknown < _LITTLE_KNOWN
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return slice(None), slice(None)
    first_row, first_col = max(int(rows[0]) - _MARGIN, 0), max(int(cols[0]) - _MARGIN, 0)
    return slice(first_row, int(rows[-1]) + _MARGIN), slice(first_col, int(cols[-1]) + _MARGIN)


def draw_grid(grid: TbmGrid, window: Window) -> bytes:
    """Return a grid's pignistic picture as a PNG: free white, occupied black, unknown grey."""
    return encode_png(Channels.from_grid(grid).pignistic[window])


def draw_channels(grid: TbmGrid) -> list[bytes]:
    """Return figure 1 as PNGs: the pignistic picture and the masses on occupied, free and unknown."""
    channels, window = Channels.from_grid(grid), window_of(grid)
    return [encode_png(i[window]) for i in (channels.pignistic, channels.occupied, channels.free, channels.unknown)]


_TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{{ title }}</title><style>
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1c1c1c }
h1 { font-size: 1.7rem } h2 { margin-top: 3rem; border-bottom: 1px solid #bbb } p { max-width: 50rem }
.wide { overflow-x: auto } table { border-collapse: collapse; font-size: .88rem; margin: 1rem 0 }
caption { text-align: left; font-weight: 600; padding: .3rem 0 }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #ddd; text-align: right; vertical-align: top;
 white-space: nowrap }
th:first-child, td:first-child { text-align: left } thead th { border-bottom: 2px solid #777; vertical-align: bottom }
td .theirs { display: block; color: #666; font-size: .82em } tr:hover { background: #f5f5f5 }
figure { margin: 1.5rem 0 } img { max-width: 100%; border: 1px solid #ccc } figcaption { font-size: .88rem }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem } .pictures figure { margin: 0; flex: 0 1 20rem }
.wide-picture { flex: 1 1 100% !important }
pre { white-space: pre-wrap; font-size: .8rem; background: #f5f5f5; padding: 1rem }
@media (prefers-color-scheme: dark) { body { background: #181818; color: #ddd } td .theirs { color: #999 }
 tr:hover, pre { background: #262626 } th, td { border-color: #444 } }
</style></head><body>
<h1>{{ title }}</h1>
{% for text in lead %}<p>{{ text }}</p>
{% endfor %}
{% for section in sections %}
<section><h2>{{ section.title }}</h2>
{% for text in section.texts %}<p>{{ text }}</p>
{% endfor %}
{% for table in section.tables %}
<div class="wide"><table><caption>{{ table.title }}</caption>
<thead><tr>{% for head in table.heads %}<th scope="col">{{ head }}</th>{% endfor %}</tr></thead><tbody>
{% for row in table.rows %}<tr>{% for cell in row %}
<td>{% for line in cell.split("\\n") %}{% if loop.first %}{{ line }}{% else %}<span class="theirs">{{ line }}</span>\
{% endif %}{% endfor %}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
{% endfor %}
{% if section.pictures %}<div class="pictures">
{% for picture in section.pictures %}<figure{% if picture.wide %} class="wide-picture"{% endif %}>
<img alt="{{ picture.caption }}" src="{{ picture.url }}">
<figcaption>{{ picture.caption }}</figcaption></figure>
{% endfor %}</div>{% endif %}
</section>
{% endfor %}
</body></html>
"""


@dataclass(frozen=True)
class PaperPicture(Picture):
    """A picture with a caption; a wide one takes the whole line."""

    wide: bool = False


@dataclass(frozen=True)
class Section:
    """A table or figure of the paper: sentences, tables and pictures."""

    title: str
    texts: Sequence[str] = ()
    tables: Sequence[Table] = ()
    """Further lines of a cell are the values of the paper."""
    pictures: Sequence[PaperPicture] = ()


def paper_page(title: str, lead: Sequence[str], sections: Sequence[Section]) -> str:
    """Return the page with all texts escaped."""
    return render(_TEMPLATE, title=title, lead=lead, sections=sections)
