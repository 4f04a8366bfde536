"""A frame with its origin near the drive.

The origin of the odometry may be very far away, for example in a grid of the whole earth. Surfels have single
precision, which resolves only half a metre there. Therefore drives are mapped in a frame with a near origin.
"""

from dataclasses import dataclass, field

from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import Reading
from tbmslam.sensing.segmentation import in_frame

FAR_M = 1000.0
"""Distance up to which single precision resolves a tenth of a millimetre [m]."""


@dataclass(frozen=True)
class LocalFrame:
    """A near frame in a far frame: translated by whole metres and not rotated."""

    T_far_near: SE2 = SE2.identity()  # noqa: RUF009  # immutable
    """Pose of the near frame in the far frame; the identity if the origin of the far frame is near."""
    is_far: bool = field(init=False)

    def __post_init__(self) -> None:
        """Compare the frames."""
        object.__setattr__(self, "is_far", self.T_far_near != SE2.identity())

    @classmethod
    def around(cls, T_far_robot: SE2 | None) -> "LocalFrame":
        """Return the frame near a pose; the far frame itself if its origin is near, or without a pose."""
        if T_far_robot is None or max(abs(T_far_robot.x), abs(T_far_robot.y)) <= FAR_M:
            return cls()
        return cls(SE2(float(round(T_far_robot.x)), float(round(T_far_robot.y)), 0.0))

    def reading(self, reading: Reading) -> Reading:
        """Return a reading with its odometry in the near frame."""
        return in_frame(reading, self.T_far_near.inverse()) if self.is_far else reading

    def pose_there(self, T_near_robot: SE2) -> SE2:
        """Return a pose in the far frame."""
        return self.T_far_near @ T_near_robot if self.is_far else T_near_robot

    def map_there(self, tbm_map: TbmMap) -> TbmMap:
        """Return a map in the far frame, with the same cells."""
        if not self.is_far:
            return tbm_map
        cells = tbm_map.grid.geometry
        origin_x, origin_y = cells.origin_x + self.T_far_near.x, cells.origin_y + self.T_far_near.y
        grid = TbmGrid(cells._replace(origin_x=origin_x, origin_y=origin_y), tbm_map.grid.cells)
        return tbm_map.moved(self.T_far_near, grid)
