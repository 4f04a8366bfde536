"""A map and what made it: the grid, the drives behind it, and where it came from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from tbmslam.grid import TbmGrid
from tbmslam.keyframes import Keyframes
from tbmslam.se2 import SE2
from tbmslam.trajectory import Trajectory


@dataclass(frozen=True)
class Drive:
    """One robot's way through the map.

    Parameters
    ----------
    name
        Who drove.
    trajectory
        Poses of the robot in the map, one for every scan that was used.
    keyframes
        Scans at poses, from which the grid can be rendered again.
    """

    name: str
    trajectory: Trajectory
    keyframes: Keyframes


@dataclass(frozen=True)
class TbmMap:
    """A map: one drive where one robot made it, several after a merge, none where only a picture was left.

    Parameters
    ----------
    grid
        The cells' masses.
    drives
        The drives behind it, in the map's frame.
    provenance
        What made it: recording, configuration, versions; anything that JSON can hold.
    """

    grid: TbmGrid
    drives: tuple[Drive, ...] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)

    def moved(self, T_new_old: SE2, grid: TbmGrid) -> "TbmMap":
        """Return the map in another frame, its drives moved and its grid replaced by one resampled there."""
        drives = tuple(
            Drive(d.name, d.trajectory.transformed(T_new_old), d.keyframes.transformed(T_new_old)) for d in self.drives
        )
        return TbmMap(grid, drives, self.provenance)
