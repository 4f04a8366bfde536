"""Warnings that merged maps inherit, and scans that two maps share."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.maps_page import by_whom


def warnings_of(provenance: Mapping[str, object]) -> list[str]:
    """Return what was odd while a map was made; of a merged map, while those in it were, under their names."""
    odd = provenance.get("warnings")
    said = [str(warning) for warning in odd] if isinstance(odd, list | tuple) else []
    return said + by_whom({name: warnings_of(inner) for name, _, inner in _parts(provenance)})


def incidents_of(one: TbmMap) -> list[object]:
    """Return what went wrong on each drive of a map, as its `run.json` says; None where nobody knows."""
    return _incidents(one.provenance, len(one.drives))


def _incidents(provenance: Mapping[str, object], drives: int) -> list[object]:
    parts = _parts(provenance)
    if sum(count for _, count, _ in parts) == drives and parts:
        return [incident for _, count, inner in parts for incident in _incidents(inner, count)]
    return [provenance.get("incidents")] if drives == 1 else [None] * drives


def _parts(provenance: Mapping[str, object]) -> list[tuple[str, int, Mapping[str, object]]]:
    """Return the name, the number of drives and the provenance of every map that went into a merged one.

    Merges wrote no number of drives before they were shown where those had trouble; then it is 0.
    """
    parts, found = provenance.get("merged_from"), list[tuple[str, int, Mapping[str, object]]]()
    for name, part in parts.items() if isinstance(parts, Mapping) else ():
        inner = part.get("provenance") if isinstance(part, Mapping) else None
        if isinstance(part, Mapping) and isinstance(inner, Mapping):
            count = part.get("drives")
            found.append((name, count if isinstance(count, int) and count > 0 else 0, inner))
    return found


_ONE_DRIVE = 0.5
"""Robots cut from one recording share less of their keyframes by default; copies of one drive share all."""


class SharedScans(NamedTuple):
    """Two maps and the keyframes that both hold.

    Parameters
    ----------
    first, second
        The maps' names.
    shared, of
        How many keyframes are the same, and how many the map with fewer has.
    """

    first: str
    second: str
    shared: int
    of: int


def drives_given_twice(maps: Mapping[str, TbmMap]) -> list[SharedScans]:
    """Return the pairs of maps, most of whose keyframes are the same scans taken at the same times."""
    scans = {name: _scans_of(one) for name, one in maps.items()}
    found = []
    for first, second in itertools.combinations(scans, 2):
        of, shared = min(len(scans[first]), len(scans[second])), len(scans[first] & scans[second])
        if shared > _ONE_DRIVE * of:
            found.append(SharedScans(first, second, shared, of))
    return found


def _scans_of(one: TbmMap) -> set[tuple[float, bytes]]:
    return {
        (stamp, keyframes.ranges[begin:end].tobytes())
        for keyframes in (drive.keyframes for drive in one.drives)
        for stamp, begin, end in zip(
            keyframes.stamps.tolist(), keyframes.offsets[:-1].tolist(), keyframes.offsets[1:].tolist(), strict=True
        )
    }
