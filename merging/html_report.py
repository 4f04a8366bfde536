"""What a merge did, as one page to look at: no scripts, no other files, everything that came from outside escaped."""

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from merging.alignment import Alignment
from merging.merger import Merge
from tbmslam.se2 import SE2

Colour = tuple[int, int, int]

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 75rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem }
th, td { padding: 0.25rem 0.7rem; border-bottom: 1px solid #ddd; text-align: left; vertical-align: top }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.swatch { display: inline-block; width: 0.8em; height: 0.8em; margin-right: 0.5em }
.accepted { color: #006b3c } .refused { color: #a40000 }
figure { margin: 0 0 1.5rem } img { max-width: 100%; border: 1px solid #ddd; image-rendering: pixelated }
"""

_POSE_HEADS = ("x [m]", "y [m]", "θ [°]")
_PAIR_HEADS = (
    *("target", "source", "", *_POSE_HEADS, "inliers", "rmse [m]", "scale"),
    *("overlap [m²]", "agreement", "conflict", "reason"),
)


def html_report(
    merge: Merge,
    areas_m2: Mapping[str, float],
    pictures: Mapping[str, tuple[bytes, str]],
    colours: Sequence[Colour],
) -> str:
    """Return the page.

    Parameters
    ----------
    merge
        What became of the maps.
    areas_m2
        Figures to tell below the pictures, by name [m^2].
    pictures
        PNG and caption of each picture, by title; none where nothing was merged.
    colours
        Red, green, blue of each merged map in the overlay, repeated where there are more maps.
    """
    if merge.merged is None:
        verdict = "No two maps could be merged."
    else:
        verdict = f"{len(merge.poses)} of {len(merge.poses) + len(merge.left_out)} maps were merged."
    parts = [
        f"<h1>Merge report</h1>\n<p>{verdict}</p>",
        *(_figure(title, png, caption) for title, (png, caption) in pictures.items()),
        "<h2>Maps</h2>\n<p>Poses in the frame of the merged map.</p>" if merge.poses else "<h2>Maps</h2>",
        _table(("map", *_POSE_HEADS, ""), [*_merged_rows(merge, colours), *_left_out_rows(merge)]),
        "<h2>Pairs</h2>\n<p>Poses of the source in the target's frame; those of refused pairs were not used.</p>",
        _table(_PAIR_HEADS, [_pair_row(*pair, found) for pair, found in merge.alignments.items()]),
    ]
    if areas_m2:
        rows = [_row([_text(name), _number(area, 1)]) for name, area in areas_m2.items()]
        parts += ["<h2>Areas</h2>", _table(("", "m²"), rows)]
    return _page("Merge report", parts)


def _page(title: str, parts: Iterable[str]) -> str:
    body = "\n".join(parts)
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _figure(title: str, png: bytes, caption: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<h2>{escape(title)}</h2>\n<figure><img alt="{escape(title)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _merged_rows(merge: Merge, colours: Sequence[Colour]) -> list[str]:
    rows = []
    for index, (name, pose) in enumerate(merge.poses.items()):
        red, green, blue = colours[index % len(colours)]
        swatch = f'<span class="swatch" style="background: rgb({red}, {green}, {blue})"></span>'
        rows.append(_row([f"<td>{swatch}{escape(name)}</td>", *_pose(pose), "<td></td>"]))
    return rows


def _left_out_rows(merge: Merge) -> list[str]:
    return [
        _row([_text(name), *_pose(None), f'<td><span class="refused">left out</span>: {escape(reason)}</td>'])
        for name, reason in merge.left_out.items()
    ]


def _pair_row(target: str, source: str, found: Alignment) -> str:
    verdict = "accepted" if found.accepted else "refused"
    return _row(
        [
            _text(target),
            _text(source),
            f'<td class="{verdict}">{verdict}</td>',
            *_pose(found.T_target_source),
            f'<td class="number">{found.inliers} of {found.matches}</td>',
            _number(found.rmse_m, 3),
            _number(found.scale, 3),
            _number(found.overlap_m2, 1),
            _number(found.agreement, 2),
            _number(found.conflict, 2),
            _text(found.reason),
        ]
    )


def _pose(pose: SE2 | None) -> list[str]:
    if pose is None:
        return [_number(None, 0)] * 3
    return [_number(pose.x, 3), _number(pose.y, 3), _number(math.degrees(pose.theta), 2)]


def _number(value: float | None, decimals: int) -> str:
    known = value is not None and math.isfinite(value)
    return f'<td class="number">{value:.{decimals}f}</td>' if known else '<td class="number">–</td>'


def _text(text: str) -> str:
    return f"<td>{escape(text)}</td>"


def _row(cells: Iterable[str]) -> str:
    return f"<tr>{''.join(cells)}</tr>"


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    return f"<table>\n<tr>{head}</tr>\n" + "\n".join(rows) + "\n</table>"
