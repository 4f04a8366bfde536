"""Maps of simulated drives, without the mapping."""

import itertools
import math
from dataclasses import replace

import numpy as np

from datasets.synthetic.robot.laser import SimulatedLaser
from merging.joint_slam import redraw
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap


def map_of(world, drive, bend, T_world_map=None):
    """What a robot maps whose heading drifts as it drives."""
    T_map_world = (T_world_map or SE2.identity()).inverse()
    laser = SimulatedLaser(beams=361, angle_min=-math.pi / 2, angle_increment=math.pi / 360, noise=0.005)
    travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(drive.poses[:, :2], axis=0).T))))
    _, first = np.unique((travelled / 0.4).astype(int), return_index=True)
    way, stamps = drive.poses[first], drive.stamps[first]
    scans = laser.scans(world, stamps, way, np.random.default_rng(1))
    remembered = [SE2.from_array(way[0])]
    for before, after in itertools.pairwise(map(SE2.from_array, way)):
        step = before.inverse() @ after
        remembered.append(remembered[-1] @ step @ SE2(0.0, 0.0, bend * math.hypot(step.x, step.y)))
    poses = [T_map_world @ pose for pose in remembered]
    keyframes = Keyframes.from_scans(scans, poses, [laser.T_robot_sensor] * len(way))
    made = Drive("robot", Trajectory(stamps, np.array(poses)), keyframes)
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4)), (made,))
    return replace(empty, grid=redraw([keyframes], empty))
