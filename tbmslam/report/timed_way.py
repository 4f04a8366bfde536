"""Where robots were at each time: what a marker needs that runs along their drives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tbmslam.geometry.se2 import FloatArray, path_lengths, wrap_angles
from tbmslam.map.drive import Drive
from tbmslam.report.palette import Colour

_STEP_M = 0.1
"""What is shown is wrong by this at the most, more only on drives of over `_MOST_STEPS`."""
_ARM_M = 0.5
"""A turn counts as the way of a point so far from the robot: 0.1 m are 11 degrees."""
_MOST_STEPS, _MOST_STEPS_OF_ALL, _LEAST_STEPS = 1000, 10_000, 20
"""Of one drive, and of all on a sheet: some 40 bytes each in the page."""


@dataclass(frozen=True)
class TimedWay:
    """One drive over time, in few poses between which the robot moved evenly.

    Parameters
    ----------
    label
        Who drove, as the switch of the drive says it.
    colour
        Red, green, blue.
    times
        Seconds (K,) since the drive began, which never fall.
    poses
        Poses (K, 3): x [m], y [m], theta [rad].
    """

    label: str
    colour: Colour
    times: FloatArray
    poses: FloatArray

    def as_json(self) -> dict[str, object]:
        """Return what the page's script needs: rows of tenths of a second, centimetres twice, and degrees."""
        degrees = np.degrees(wrap_angles(self.poses[:, 2]))
        rows = np.column_stack((10.0 * self.times, 100.0 * self.poses[:, :2], degrees))
        red, green, blue = self.colour
        return {
            "label": self.label,
            "colour": f"rgb({red}, {green}, {blue})",
            "rows": np.rint(rows).astype(np.int64).tolist(),
        }


def timed_ways(drives: Sequence[Drive], colours: Sequence[Colour]) -> tuple[TimedWay, ...]:
    """Return every drive over time, without those that took no time.

    Where a recorder's clock stepped back, its stamps do not tell the time: the scans are then spread evenly over it.
    """
    most = max(min(_MOST_STEPS, _MOST_STEPS_OF_ALL // max(len(drives), 1)), _LEAST_STEPS)
    ways = []
    for drive, colour in zip(drives, colours, strict=True):
        stamps, poses = drive.trajectory.stamps, drive.trajectory.poses
        if not len(stamps) or stamps.max() <= stamps.min():
            continue
        times = stamps - stamps[0]
        if (np.diff(stamps) < 0.0).any():
            times = np.linspace(0.0, float(stamps.max() - stamps.min()), len(stamps))
        kept = _kept(poses, most)
        ways.append(TimedWay(drive.name, colour, times[kept], poses[kept]))
    return tuple(ways)


def _kept(poses: FloatArray, most: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return indices of the first and the last pose of each step of the way: robots may rest for long within one."""
    turned = np.zeros(len(poses))
    np.cumsum(np.abs(wrap_angles(np.diff(poses[:, 2]))), out=turned[1:])
    moved = path_lengths(poses) + _ARM_M * turned
    step = max(_STEP_M, float(moved[-1]) / most)
    ends = np.flatnonzero(np.diff((moved / step).astype(np.int64)))
    return np.unique(np.concatenate(([0], ends, ends + 1, [len(poses) - 1])))
