"""Warnings of equal incidents as one line."""

import re
from collections.abc import Iterable

_TIMED, _LASTS = re.compile(r"at (-?[\d.]+) s: (.*)"), re.compile(r", for [\d.]+ s")
_MOST_TIMES = 5


def gathered(warnings: Iterable[str]) -> list[str]:
    """Return warnings, where those that differ in their time only are one with their first times."""
    times: dict[str, list[tuple[str, str]]] = {}
    for warning in warnings:
        timed = _TIMED.fullmatch(warning)
        what, at = (_LASTS.sub("", timed[2]), timed[1]) if timed else (warning, "")
        times.setdefault(what, []).append((at, warning))
    gathered = []
    for what, found in times.items():
        if len(found) == 1:
            gathered.append(found[0][1])
            continue
        more = f" and {len(found) - _MOST_TIMES} more times" if len(found) > _MOST_TIMES else ""
        gathered.append(f"at {', '.join(at for at, _ in found[:_MOST_TIMES])} s{more}: {what}")
    return gathered
