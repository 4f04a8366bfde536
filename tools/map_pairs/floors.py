"""Which pairs of maps show which building, by their names, so that a building can be held out."""

import re
from collections.abc import Iterable

_OF_ONE = re.compile(r"(crop_(?P<building>.+?)(_\d+)?_\d{3})|(negs_(?P<same>[a-z].*?)_\d+)")
_VARIANT = r"(part\d+)?(mir)*"
"""A part of a building, and the building as a mirror shows it, are no other building."""


def floors_of(names: Iterable[str]) -> dict[str, frozenset[str]]:
    """Return for each pair's name the buildings that it shows, one or two.

    Buildings are known by the names of the pairs of one building, `crop_BUILDING_OVERLAP`, `crop_BUILDING_SEED_OVERLAP`
    and `negs_BUILDING_SEED`; a pair of two places is held to show every building that its name names.
    """
    names = list(names)
    named = [found["building"] or found["same"] for found in map(_OF_ONE.fullmatch, names) if found]
    floors = {re.sub(_VARIANT + "$", "", _plain(building)) for building in named}
    shown = {floor: re.compile(f"-{re.escape(floor)}{_VARIANT}-") for floor in sorted(floors)}
    return {
        name: frozenset(floor for floor, pattern in shown.items() if pattern.search(f"-{_plain(name)}-"))
        for name in names
    }


def shows_part(name: str) -> bool:
    """Tell whether a pair shows a part of a building, by its name."""
    return re.search(r"part\d+", name) is not None


def _plain(name: str) -> str:
    return name.replace("_", "-")
