"""How far maps and merges are from a simulated building's truth."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from datasets.synthetic.world.world import World
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.evaluation.map_agreement import cell_labels
from tbmslam.evaluation.trajectory_errors import TrajectoryAlignment, align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.io.trajectory_file import read_tum

ONE_CELL_AROUND = np.ones((3, 3), dtype=bool)


def placed(bags: Path, maps: Path, name: str, bag: str | None = None) -> TrajectoryAlignment:
    """Lay a robot's trajectory onto its true one; its transform is the map's true pose in the world."""
    truth = read_tum(bags / f"{bag or name}.truth.tum")
    return align_trajectories(truth, read_tum(maps / name / "trajectory.tum"))


def alignment_errors(
    report: Mapping[str, Any], T_world_map: Mapping[str, SE2], names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Return how far each merged map [m] and [deg] is from where it belongs beside the one that gives the frame."""
    errors = {}
    for name in names:
        T_merged_map = SE2(*report["maps"][name]["T_merged_map"])
        true = T_world_map[report["frame"]].inverse() @ T_world_map[name]
        difference = true.inverse() @ T_merged_map
        errors[name] = (math.hypot(difference.x, difference.y), abs(math.degrees(difference.theta)))
    return errors


def share_of_cells_as_in(world: World, grid: TbmGrid, T_world_map: SE2) -> float:
    """Return the share of a map's cells, of all that it calls free or occupied, that are so in the true world.

    With a tolerance of one cell, since a wall half a cell off fills the cell beside the true one: an occupied cell
    must have a truly occupied one at or next to it, a free cell a truly free one. A cell where the world has no
    inside counts as wrong.
    """
    labels, truth = cell_labels(grid), world.occupancy(grid.geometry, T_world_map)
    right = np.zeros(labels.shape, dtype=bool)
    for label in (FREE, OCCUPIED):
        right |= (labels == label) & ndimage.binary_dilation(truth == label, ONE_CELL_AROUND)
    return float(right[labels != UNKNOWN].mean())
