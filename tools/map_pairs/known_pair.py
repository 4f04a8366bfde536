"""Two maps and their true relative pose, and the file of such a pair."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datasets.synthetic.map_pairs.pairs import MapPair
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.map.map_check import check_geometry
from tbmslam.map.tbm_map import TbmMap
from tbmslam.special_file import why_unreadable

_RIGHT_M, _RIGHT_DEG = 0.5, 2.0
_NEAR_DEG = 4.0
_REMEDY = "make pairs with tools/make_map_pairs.py"


class PairFileError(TbmSlamError):
    """A file does not hold a pair of maps."""


@dataclass(frozen=True)
class KnownPair:
    """Two maps and the truth about them."""

    name: str
    target: TbmMap
    source: TbmMap
    T_target_source: SE2 | None
    """The true pose; None if the maps show different places."""
    overlap: float
    """Share of the smaller map's free cells that both know."""

    @classmethod
    def of(cls, pair: MapPair) -> "KnownPair":
        """Return a pair that was cut from a building."""
        maps = [TbmMap.from_occupancy(occupancy, pair.resolution) for occupancy in (pair.occ_a, pair.occ_b)]
        return cls(pair.name, maps[0], maps[1], pair.T_a_b, pair.overlap)

    def errors(self, found: SE2) -> tuple[float, float]:
        """Return the errors of an alignment at the centre of the known part of the source [m], [deg]."""
        if self.T_target_source is None:
            raise ValueError(f"{self.name} has no true alignment")
        geometry = self.source.grid.geometry
        rows, cols = np.nonzero(self.source.grid.is_known())
        middle = geometry.centre_of(float(rows.mean()), float(cols.mean()))
        apart = np.linalg.norm(found.apply(middle) - self.T_target_source.apply(middle))
        return float(apart), abs(math.degrees(wrap_angle(found.theta - self.T_target_source.theta)))

    def is_right(self, found: SE2 | None, most_deg: float = _RIGHT_DEG) -> bool:
        """Return whether an alignment is right within 0.5 m and an angle."""
        if found is None or self.T_target_source is None:
            return False
        metres, degrees = self.errors(found)
        return metres <= _RIGHT_M and degrees <= most_deg

    def is_near(self, found: SE2 | None) -> bool:
        """Return whether an alignment is right within 0.5 m and 4 degrees, the tolerance for deformed maps."""
        return self.is_right(found, _NEAR_DEG)


def load_pair(path: Path) -> KnownPair:
    """Read a file of occupancies `occ_a`, `occ_b` [%], -1 unknown, `resolution`, `T_ab` (3, 3), `label`, `overlap`."""
    if why := "is no file but a folder" if path.is_dir() else why_unreadable(path):
        raise PairFileError(f"{path} {why}: give a folder of pairs")
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as arrays:
            resolution, label = float(arrays["resolution"]), int(arrays["label"])
            maps = [TbmMap.from_occupancy(arrays[key], resolution) for key in ("occ_a", "occ_b")]
            motion = np.asarray(arrays["T_ab"], dtype=np.float64)
            overlap = float(arrays["overlap"])
    except Exception as error:  # damaged zips and headers raise many types, also zlib.error and tokenize.TokenError
        raise PairFileError(f"{path} is not a pair of maps: {error}: {_REMEDY}") from error
    for one in maps:
        check_geometry(path, one.grid.geometry)
    faults = [one.grid.fault() for one in maps]
    if label and not (motion.shape == (3, 3) and np.isfinite(motion).all()):
        faults.append("T_ab is no finite matrix (3, 3)")
    if fault := next(filter(None, faults), None):
        raise PairFileError(f"{path} is not a pair of maps: {fault}: {_REMEDY}")
    return KnownPair(path.stem, maps[0], maps[1], SE2.from_matrix(motion) if label else None, overlap)
