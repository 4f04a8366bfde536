"""Warnings that merged maps inherit, and scans that two maps share."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.maps_page import joined_warnings


def warnings_of(provenance: Mapping[str, object]) -> list[str]:
    """Return the warnings of a map, and for a merged map the warnings of its parts with their names."""
    recorded = provenance.get("warnings")
    warnings = [str(warning) for warning in recorded] if isinstance(recorded, list | tuple) else []
    return warnings + joined_warnings({name: warnings_of(inner) for name, _, inner in _parts(provenance)})


def incidents_of(tbm_map: TbmMap) -> list[object]:
    """Return the incidents of each drive of a map, as in `run.json`; None for drives without a record."""
    return _incidents(tbm_map.provenance, len(tbm_map.drives))


def _incidents(provenance: Mapping[str, object], drives: int) -> list[object]:
    parts = _parts(provenance)
    if sum(count for _, count, _ in parts) == drives and parts:
        return [incident for _, count, inner in parts for incident in _incidents(inner, count)]
    return [provenance.get("incidents")] if drives == 1 else [None] * drives


def _parts(provenance: Mapping[str, object]) -> list[tuple[str, int, Mapping[str, object]]]:
    """Return the name, the number of drives (0 if unknown) and the provenance of every part of a merged map."""
    parts, found = provenance.get("merged_from"), list[tuple[str, int, Mapping[str, object]]]()
    for name, part in parts.items() if isinstance(parts, Mapping) else ():
        inner = part.get("provenance") if isinstance(part, Mapping) else None
        if isinstance(part, Mapping) and isinstance(inner, Mapping):
            count = part.get("drives")
            found.append((name, count if isinstance(count, int) and count > 0 else 0, inner))
    return found


_ONE_DRIVE = 0.5
"""Least share of common keyframes for one drive: parts of a recording share less, copies of a drive share all."""


class SharedScans(NamedTuple):
    """Two maps with common keyframes."""

    first: str
    second: str
    shared: int
    of: int
    """The number of common keyframes, and the number of keyframes of the map with fewer."""


def duplicate_drives(maps: Mapping[str, TbmMap]) -> list[SharedScans]:
    """Return the pairs of maps that share most keyframes: equal scans with equal stamps."""
    scans = {name: _scans_of(tbm_map) for name, tbm_map in maps.items()}
    found = []
    for first, second in itertools.combinations(scans, 2):
        of, shared = min(len(scans[first]), len(scans[second])), len(scans[first] & scans[second])
        if shared > _ONE_DRIVE * of:
            found.append(SharedScans(first, second, shared, of))
    return found


def _scans_of(tbm_map: TbmMap) -> set[tuple[float, bytes]]:
    return {
        (stamp, keyframes.ranges[begin:end].tobytes())
        for keyframes in (drive.keyframes for drive in tbm_map.drives)
        for stamp, begin, end in zip(
            keyframes.stamps.tolist(), keyframes.offsets[:-1].tolist(), keyframes.offsets[1:].tolist(), strict=True
        )
    }
