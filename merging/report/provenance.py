"""What went wrong while maps were made: told by those who made them, and handed on by every merge since."""

from collections.abc import Mapping

from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.shared_warnings import by_whom


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
