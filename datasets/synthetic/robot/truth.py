"""What is true of a simulated recording, in files beside it, for evaluation only."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from datasets.synthetic.robot.simulation import SimulatedRobot
from datasets.synthetic.world.world import World
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.atomic_file import write_text

_SOURCE = "the simulated world, ground truth"
"""What the file is, and those of build_maps, which have the same name, are not."""


def write_truth(
    folder: Path, world: World, robots: Sequence[SimulatedRobot], bags: Sequence[str], run: Mapping[str, object]
) -> None:
    """Write `world.npz`, `<bag stem>.truth.tum` a robot and `truth.json` into a folder, each whole or not at all.

    Parameters
    ----------
    bags
        Name of each robot's bag in the folder.
    run
        What made the recording: seed, odometry noise and the like; anything that JSON can hold.
    """
    world.save(folder / "world.npz")
    entries = []
    for robot, bag in zip(robots, bags, strict=True):
        tum = f"{Path(bag).stem}.truth.tum"
        write_text(folder / tum, tum_text(robot.truth))
        entries.append(
            {
                "name": robot.name,
                "bag": bag,
                "trajectory": tum,
                "T_world_robot": list(robot.truth.pose(0)),
                "scans": len(robot.readings),
                "length_m": robot.truth.length(),
                "duration_s": float(robot.truth.stamps[-1] - robot.truth.stamps[0]),
            }
        )
    laser = robots[0].laser
    truth = {
        **run,
        "source": _SOURCE,
        "world": {"name": world.name, "seed": world.seed, "file": "world.npz"},
        "laser": {**vars(laser), "T_robot_sensor": list(laser.T_robot_sensor)},
        "robots": entries,
    }
    write_text(folder / "truth.json", json.dumps(truth, indent=2, sort_keys=True) + "\n")


def tum_text(trajectory: Trajectory) -> str:
    """Return a trajectory as TUM text: stamp x y z qx qy qz qw a line."""
    lines = (
        f"{stamp:.9f} {x:.9f} {y:.9f} 0 0 0 {math.sin(theta / 2.0):.9f} {math.cos(theta / 2.0):.9f}\n"
        for stamp, (x, y, theta) in zip(trajectory.stamps, trajectory.poses, strict=True)
    )
    return "".join(lines)
