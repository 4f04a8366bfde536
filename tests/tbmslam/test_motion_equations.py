import numpy as np
import pytest

from tbmslam.motion_equations import MotionEquations
from tbmslam.pose_graph import MotionEdge, edge_errors, relative_pose
from tbmslam.se2 import SE2, compose

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


def test_the_gradient_is_that_of_the_squared_deviations(edges, poses, places):
    _, gradient = MotionEquations.of(edges, OWNERS, places).system(poses, None)
    for k in range(3):
        for axis in range(3):
            step = np.zeros_like(poses)
            step[k, axis] = 1e-6
            slope = (cost(edges, poses + step, places) - cost(edges, poses - step, places)) / 2e-6
            assert gradient[k, axis] == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_the_curvature_tells_how_the_gradient_changes_where_motions_are_met(edges, poses, places):
    views = compose(poses[OWNERS], places)
    met = [MotionEdge(e.source, e.target, relative_pose(views, e.source, e.target), e.information) for e in edges]
    equations = MotionEquations.of(met, OWNERS, places)
    curvature, gradient = equations.system(poses, None)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-9)
    np.testing.assert_allclose(curvature.toarray(), curvature.toarray().T, atol=1e-9)
    for number in range(9):
        step = np.zeros(9)
        step[number] = 1e-6
        _, after = equations.system(poses + step.reshape(3, 3), None)
        np.testing.assert_allclose(after.ravel() / 1e-6, curvature @ (step / 1e-6), rtol=1e-3, atol=1e-3)


def test_a_motion_loses_its_say_with_its_error(edges, poses, places):
    edge = edges[0]
    off = edge_errors(
        [MotionEdge(0, 1, edge.T_source_target, edge.information)], compose(poses[OWNERS], places)[[0, 2]]
    )
    believed, doubted = (
        MotionEquations.of([edge], OWNERS, places).system(poses, width)[0].toarray() for width in (None, 2.0)
    )
    np.testing.assert_allclose(doubted, believed / (1.0 + off[0] ** 2 / 4.0), rtol=0.05)
    assert doubted.max() < believed.max()


def test_no_motions_say_nothing(poses, places):
    curvature, gradient = MotionEquations.of([], OWNERS, places).system(poses, 2.0)
    assert curvature.shape == (9, 9)
    assert curvature.nnz == 0
    assert not gradient.any()
