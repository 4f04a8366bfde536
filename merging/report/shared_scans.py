"""Maps that hold the same scans: one drive that counts as two robots."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

from tbmslam.map.tbm_map import TbmMap

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
