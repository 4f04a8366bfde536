import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import LineSystem, PoseSystem
from tbmslam.optimisation.drive_bends import bends_of
from tbmslam.optimisation.motion_equations import motions_of
from tbmslam.optimisation.pose_graph import MotionEdge
from tbmslam.optimisation.pose_solver import PoseSolver

COUNT = 20


def test_what_is_solved_is_as_near_to_the_right_side_as_asked(generator):
    poses = np.cumsum(generator.normal(0.0, 0.3, (COUNT, 3)), axis=0)
    edges = [MotionEdge(k, k + 1, SE2(0.3, 0.0, 0.1), np.diag([4e2, 3e2, 9e2])) for k in range(COUNT - 1)]
    motions = motions_of(edges, [], 1.0, np.arange(COUNT), np.zeros((COUNT, 3)))
    own, between, _ = motion_equations(motions, poses)
    nothing = np.zeros(0, dtype=np.int64)
    lines = LineSystem(np.zeros((0, 3, 2)), np.zeros((0, 3)), nothing, np.zeros(1, dtype=np.int64))
    solver = PoseSolver(PoseSystem(own + np.eye(3), lines, between), poses, bends_of([0, COUNT]), 1e-8)
    for _ in range(2):
        side = generator.normal(size=(COUNT, 3))
        solved = solver.solved(side)
        np.testing.assert_allclose(solver.curved(solved), side, atol=1e-6)
        assert np.abs(solved).max() > 1e-3
