"""What several robots are told alike, said once."""

from collections.abc import Iterable, Mapping

_MOST_NAMES = 5
"""So many robots are named where several are told the same."""


def by_whom(told: Mapping[str, Iterable[str]]) -> list[str]:
    """Return every warning once, with the names of those that it is told of: one recording's are those of all.

    Parameters
    ----------
    told
        What each robot is told, by name. What names a time is alike only where that is the same.
    """
    whose: dict[str, list[str]] = {}
    for name, warnings in told.items():
        for warning in dict.fromkeys(warnings):
            whose.setdefault(warning, []).append(name)
    return [f"{_listed(names)}: {warning}" for warning, names in whose.items()]


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"
