"""Keyframes of a drive: scans with their poses, from which the map can be rendered again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tbmslam.geometry.se2 import SE2, FloatArray, compose, median_pose
from tbmslam.sensing.laser_scan import LaserScan


@dataclass(frozen=True, repr=False)
class Keyframes:
    """Scans at poses, as arrays."""

    stamps: FloatArray
    """Times (K,) [s]."""
    poses: FloatArray
    """Poses (K, 3) of the robot in the map: x [m], y [m], theta [rad]."""
    sensor_poses: FloatArray
    """Poses (K, 3) of the laser on the robot."""
    beams: FloatArray
    """Angle and range limits (K, 4): angle_min, angle_increment [rad], range_min, range_max [m]."""
    offsets: npt.NDArray[np.int64]
    """Begin of each scan in `ranges`, and end of the last scan (K + 1,)."""
    ranges: npt.NDArray[np.float32]
    """All scans' ranges one after another, float32 [m], coded as in `LaserScan`."""
    beam_steps: FloatArray
    """Motions (K, 3) of the laser from one beam to the next: x [m], y [m], theta [rad]."""
    indices: npt.NDArray[np.int64]
    """Rising indices (K,) of their poses in the drive's trajectory; stamps may step back."""

    def __post_init__(self) -> None:
        """Check the shapes and values of the arrays."""
        count = len(self.stamps)
        arrays = (self.poses, self.sensor_poses, self.beams, self.offsets, self.beam_steps, self.indices)
        shapes = tuple(values.shape for values in arrays)
        if shapes != ((count, 3), (count, 3), (count, 4), (count + 1,), (count, 3), (count,)):
            raise ValueError(f"keyframe arrays must agree on {count} keyframes, got shapes {shapes}")
        if self.offsets[0] != 0 or self.offsets[-1] != len(self.ranges) or np.any(np.diff(self.offsets) < 0):
            raise ValueError(f"offsets must rise from 0 to the {len(self.ranges)} ranges")
        if np.any(self.indices < 0) or np.any(np.diff(self.indices) <= 0):
            raise ValueError("indices into the trajectory must rise from 0 or later, none of them twice")
        # Only range_max may be infinite, for a laser without a limit.
        numbers = (self.stamps, self.poses, self.sensor_poses, self.beams[:, :3], self.beam_steps)
        if not all(np.isfinite(values).all() for values in numbers) or np.isnan(self.beams).any():
            raise ValueError("stamps, poses and beams must be finite")
        if (self.ranges < 0.0).any():
            raise ValueError("ranges must not be negative")

    @classmethod
    def from_scans(
        cls,
        scans: Sequence[LaserScan],
        poses: Sequence[SE2],
        sensor_poses: Sequence[SE2],
        indices: Sequence[int] | None = None,
    ) -> "Keyframes":
        """Pack scans taken at robot poses in the map by lasers mounted at sensor poses.

        `indices` of the poses in the trajectory; None for the first poses.
        """
        return cls(
            stamps=np.array([scan.stamp for scan in scans], dtype=np.float64),
            poses=np.array(poses, dtype=np.float64).reshape(-1, 3),
            sensor_poses=np.array(sensor_poses, dtype=np.float64).reshape(-1, 3),
            beams=np.array(
                [(s.angle_min, s.angle_increment, s.range_min, s.range_max) for s in scans], dtype=np.float64
            ).reshape(-1, 4),
            offsets=np.concatenate(([0], np.cumsum([len(scan.ranges) for scan in scans]))).astype(np.int64),
            ranges=np.concatenate([np.zeros(0, np.float32), *(scan.ranges.astype(np.float32) for scan in scans)]),
            beam_steps=np.array([scan.beam_step for scan in scans], dtype=np.float64).reshape(-1, 3),
            indices=np.array(range(len(scans)) if indices is None else indices, dtype=np.int64),
        )

    def __repr__(self) -> str:
        """Return one line: the numbers of keyframes and of their beams."""
        return f"Keyframes({len(self)} scans, {len(self.ranges)} beams)"

    def __len__(self) -> int:
        """Return the number of keyframes."""
        return len(self.stamps)

    def scan(self, index: int) -> LaserScan:
        """Return one keyframe's scan."""
        angle_min, angle_increment, range_min, range_max = (float(value) for value in self.beams[index])
        ranges = self.ranges[self.offsets[index] : self.offsets[index + 1]].astype(np.float64)
        return LaserScan(
            float(self.stamps[index]),
            angle_min,
            angle_increment,
            range_min,
            range_max,
            ranges,
            beam_step=SE2.from_array(self.beam_steps[index]),
        )

    def pose(self, index: int) -> SE2:
        """Return the robot's pose in the map at one keyframe."""
        return SE2.from_array(self.poses[index])

    def sensor_pose(self, index: int) -> SE2:
        """Return the laser's pose in the map at one keyframe."""
        return self.pose(index) @ SE2.from_array(self.sensor_poses[index])

    def mounting(self) -> SE2:
        """Return the mount of the laser, T_robot_sensor; if it changed, the median."""
        return median_pose(self.sensor_poses)

    def all_sensor_poses(self) -> FloatArray:
        """Return the laser's poses (K, 3) in the map."""
        return compose(self.poses, self.sensor_poses)

    def transformed(self, T_new_old: SE2) -> "Keyframes":
        """Return the same keyframes in another frame."""
        return replace(self, poses=compose(np.array([T_new_old]), self.poses))
