import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, compose
from tbmslam.kernels.adjustment.motion_systems import motion_equations
from tbmslam.kernels.adjustment.pose_systems import LineSystem, PoseSystem, times
from tbmslam.optimisation.graph_optimisation import optimise
from tbmslam.optimisation.pose_graph import (
    EdgeArrays,
    MotionChain,
    MotionEdge,
    PoseSolver,
    coarse_space_of,
    edge_errors,
    motions_of,
    relative_pose,
)


def test_error_counts_standard_deviations():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    edge = MotionEdge(0, 1, SE2(0.7, 0.0, 0.0), np.diag([100.0, 1.0, 1.0]))
    assert edge_errors([edge], poses) == pytest.approx(3.0)


def test_errors_are_those_of_the_logarithm(generator):
    poses = generator.normal(0.0, 2.0, (20, 3))
    edges = []
    for k in range(19):
        root = generator.normal(0.0, 1.0, (3, 3))
        edges.append(MotionEdge(k, k + 1, SE2(*generator.normal(0.0, 1.0, 3)), root @ root.T))
    for edge, error in zip(edges, edge_errors(edges, poses), strict=True):
        twist = np.array((edge.T_source_target.inverse() @ relative_pose(poses, edge.source, edge.target)).log())
        assert error == pytest.approx(np.sqrt(twist @ edge.information @ twist))
    assert edge_errors([], poses).shape == (0,)


@pytest.fixture
def drive(generator):
    """A winding chain of 60 poses with uneven information, and two closures."""
    poses = [SE2.identity()]
    for _ in range(59):
        poses.append(poses[-1] @ SE2(0.4, 0.02, float(generator.normal(0.05, 0.1))))
    poses = np.array(poses)
    chain = []
    for k in range(59):
        root = generator.normal(0.0, 1.0, (3, 3)) * [0.01, 0.01, 0.003] + np.diag([0.02, 0.01, 0.005])
        chain.append(MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), np.linalg.inv(root @ root.T)))
    information = np.diag([1e4, 1e4, 1e5])
    closures = [
        MotionEdge(0, 50, relative_pose(poses, 0, 50) @ SE2(0.05, -0.08, 0.02), information),
        MotionEdge(10, 40, relative_pose(poses, 10, 40) @ SE2(0.02, 0.03, -0.01), information),
    ]
    return poses, chain, closures


def test_solving_the_skeleton_is_solving_the_drive(drive):
    poses, chain, closures = drive
    nodes = np.array([0, 10, 23, 40, 50, 59])
    few = optimise(poses, MotionChain.of(chain).between(nodes), closures, 1e6, nodes)
    every = optimise(poses, EdgeArrays.of(chain), closures, 1e6)
    assert np.abs(every - poses).max() > 0.02
    np.testing.assert_allclose(few, every[nodes], atol=1e-3)


def test_one_node_has_no_motions(drive):
    _, chain, _ = drive
    assert MotionChain.of(chain).between(np.array([0])).ends.shape == (0, 2)


COUNT = 20


def test_the_residual_is_as_small_as_requested(generator):
    poses = np.cumsum(generator.normal(0.0, 0.3, (COUNT, 3)), axis=0)
    edges = [MotionEdge(k, k + 1, SE2(0.3, 0.0, 0.1), np.diag([4e2, 3e2, 9e2])) for k in range(COUNT - 1)]
    motions = motions_of(EdgeArrays.of(edges), EdgeArrays.of([]), 1.0, np.arange(COUNT), np.zeros((COUNT, 3)))
    own, between, _ = motion_equations(motions, poses)
    nothing = np.zeros(0, dtype=np.int64)
    lines = LineSystem(np.zeros((0, 3, 2)), np.zeros((0, 3)), nothing, np.zeros(1, dtype=np.int64))
    system = PoseSystem(own + np.eye(3), lines, between)
    solver = PoseSolver(system, poses, coarse_space_of([0, COUNT]), 1e-8)
    for _ in range(2):
        side = generator.normal(size=(COUNT, 3))
        solved = solver.solve(side)
        np.testing.assert_allclose(times(system, solved), side, atol=1e-6)
        assert np.abs(solved).max() > 1e-3


@pytest.mark.parametrize("ends", [[0, 1], [0, 2], [0, 20], [0, 1, 1 + 17, 18 + 2], [0, 5000]])
def test_each_pose_lies_between_two_knots_of_its_own_drive(ends):
    coarse = coarse_space_of(ends)
    knots = coarse.knots[coarse.sides]
    poses = np.arange(ends[-1])
    np.testing.assert_allclose(coarse.shares.sum(axis=1), 1.0)
    np.testing.assert_allclose((coarse.shares * knots).sum(axis=1), poses, atol=1e-9)
    assert np.all(coarse.shares >= 0.0)
    drive = np.searchsorted(ends, poses, side="right")
    np.testing.assert_array_equal(np.searchsorted(ends, knots, side="right"), np.column_stack((drive, drive)))


def test_long_drives_have_a_limited_number_of_knots():
    assert 4 <= len(coarse_space_of([0, 20]).knots) <= 5
    assert len(coarse_space_of([0, 100_000]).knots) <= 252
    assert len(coarse_space_of(np.linspace(0, 100_000, 11).astype(int).tolist()).knots) <= 270


OWNERS = np.array([0, 0, 1, 2])


@pytest.fixture
def poses(generator):
    return np.column_stack((generator.uniform(-3.0, 3.0, (3, 2)), generator.uniform(-3.0, 3.0, 3)))


@pytest.fixture
def places(generator):
    return np.column_stack((generator.uniform(-1.0, 1.0, (4, 2)), generator.uniform(-3.0, 3.0, 4)))


@pytest.fixture
def edges(poses, places, generator):
    views, made = compose(poses[OWNERS], places), []
    for source, target in ((0, 2), (2, 3), (3, 1), (0, 1)):
        root = generator.normal(size=(3, 3))
        motion = relative_pose(views, source, target) @ SE2(*generator.normal(0.0, 0.05, 3))
        made.append(MotionEdge(source, target, motion, root @ root.T + np.eye(3)))
    return made


def cost(edges, poses, places):
    """Return half of the squared deviations of motions, in the target's frame as measured."""
    views, total = compose(poses[OWNERS], places), 0.0
    for edge in edges:
        found, measured = relative_pose(views, edge.source, edge.target), edge.T_source_target
        way = SE2(0.0, 0.0, -measured.theta).apply(np.array([found.x - measured.x, found.y - measured.y]))
        error = np.array([*way, (found.theta - measured.theta + np.pi) % (2.0 * np.pi) - np.pi])
        total += 0.5 * error @ edge.information @ error
    return total


def system_of(believed, doubted, poses, places):
    """Return the whole curvature (9, 9) and the gradient (3, 3)."""
    own, system, gradient = motion_equations(
        motions_of(EdgeArrays.of(believed), EdgeArrays.of(doubted), 2.0, OWNERS, places), poses
    )
    curvature = np.zeros((9, 9))
    for k in range(3):
        curvature[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = own[k]
    for (source, target), across in zip(system.ends, system.across, strict=True):
        curvature[3 * source : 3 * source + 3, 3 * target : 3 * target + 3] += across
        curvature[3 * target : 3 * target + 3, 3 * source : 3 * source + 3] += across.T
    return curvature, gradient


def test_the_gradient_is_that_of_the_squared_deviations(edges, poses, places):
    _, gradient = system_of(edges, [], poses, places)
    for k in range(3):
        for axis in range(3):
            step = np.zeros_like(poses)
            step[k, axis] = 1e-6
            slope = (cost(edges, poses + step, places) - cost(edges, poses - step, places)) / 2e-6
            assert gradient[k, axis] == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_the_curvature_tells_how_the_gradient_changes_where_motions_are_met(edges, poses, places):
    views = compose(poses[OWNERS], places)
    met = [MotionEdge(e.source, e.target, relative_pose(views, e.source, e.target), e.information) for e in edges]
    curvature, gradient = system_of(met, [], poses, places)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-9)
    np.testing.assert_allclose(curvature, curvature.T, atol=1e-9)
    for number in range(9):
        step = np.zeros(9)
        step[number] = 1e-6
        _, after = system_of(met, [], poses + step.reshape(3, 3), places)
        np.testing.assert_allclose(after.ravel() / 1e-6, curvature @ (step / 1e-6), rtol=1e-3, atol=1e-3)


def test_a_motion_loses_its_say_with_its_error(edges, poses, places):
    edge = edges[0]
    off = edge_errors(
        [MotionEdge(0, 1, edge.T_source_target, edge.information)], compose(poses[OWNERS], places)[[0, 2]]
    )
    believed, doubted = system_of([edge], [], poses, places)[0], system_of([], [edge], poses, places)[0]
    np.testing.assert_allclose(doubted, believed / (1.0 + off[0] ** 2 / 4.0), rtol=0.05)
    assert doubted.max() < believed.max()


def test_no_motions_say_nothing(poses, places):
    curvature, gradient = system_of([], [], poses, places)
    assert not curvature.any()
    assert not gradient.any()
