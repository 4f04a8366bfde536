"""The truth of an evaluation: a world, a map, or the trajectory of a robot or of its laser."""

import math
from collections.abc import Sequence
from pathlib import Path

from datasets.synthetic.world.world import World, WorldError, load_world
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.map_agreement import Labels, cell_labels
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map
from tbmslam.io.trajectory_file import ReferenceTrajectory
from tbmslam.map.map_check import MapFileError
from tools.command_line.paths import holds_map


def true_trajectory(
    reference: ReferenceTrajectory, path: Path, estimate: Path, sensor_pose: Sequence[float] | None
) -> Trajectory:
    """Return the true trajectory of the robot; the mount of the laser is given or in the map beside the estimate."""
    if reference.frame == "robot":
        return reference.trajectory
    if sensor_pose is not None:
        x, y, degrees = sensor_pose
        return reference.of_robot(SE2(x, y, math.radians(degrees)))
    if holds_map(estimate.parent):
        drives = load_map(estimate.parent).drives
        if drives and len(drives[0].keyframes):
            return reference.of_robot(drives[0].keyframes.mounting())
    raise TbmSlamError(
        f"{path} holds poses of the laser, and no map with keyframes beside {estimate} states its mounting: pass "
        "--sensor-pose X Y DEG"
    )


def load_truth(path: Path) -> World | TbmGrid:
    """Read a world or a map: both may be .npz."""
    if path.suffix == ".npz" and path.is_file():
        try:
            return load_world(path)
        except WorldError as error:
            no_world = error
        try:
            return load_map(path).grid
        except MapFileError as error:
            raise TbmSlamError(f"{error}; and {no_world}") from None
    return load_map(path).grid


def own_labels(truth: World | TbmGrid, resolution: float, min_evidence: float) -> tuple[Labels, GridGeometry]:
    """Return the true labels on the cells of the truth; those of a world have the given size."""
    if isinstance(truth, TbmGrid):
        return cell_labels(truth, min_evidence), truth.geometry
    geometry = truth.grid(resolution)
    return truth.occupancy(geometry), geometry


def labels_at(truth: World | TbmGrid, geometry: GridGeometry, T_truth_map: SE2, min_evidence: float) -> Labels:
    """Return the true labels on the cells of a map at T_truth_map."""
    if isinstance(truth, TbmGrid):
        return cell_labels(resample(truth, T_truth_map.inverse(), geometry), min_evidence)
    return truth.occupancy(geometry, T_truth_map)


def pose_figures(pose: SE2) -> dict[str, float]:
    """Return a pose as figures [m, deg]."""
    return {"x_m": pose.x, "y_m": pose.y, "theta_deg": math.degrees(pose.theta)}
