import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, compose, inverse, wrap_angles
from tbmslam.optimisation.graph_optimisation import relative_covariance
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose


@pytest.fixture
def chain(generator):
    """Poses (12, 3) of a winding drive, and the motions between them with uneven covariances."""
    poses = [SE2.identity()]
    for _ in range(11):
        poses.append(poses[-1] @ SE2(0.5, 0.02, float(generator.normal(0.1, 0.3))))
    poses = np.array(poses)
    edges = []
    for k in range(11):
        root = generator.normal(0.0, 1.0, (3, 3)) * 0.003 + np.diag([0.02, 0.01, 0.02])
        edges.append(MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), np.linalg.inv(root @ root.T)))
    return poses, edges


def numeric_covariance(poses, edges, source, target):
    """Invert the Gauss-Newton matrix of all poses, each moved in its own frame by finite differences."""
    ends = np.array([(edge.source, edge.target) for edge in edges])
    measured = np.array([edge.T_source_target for edge in edges])

    def residuals(steps):
        moved = compose(poses, steps.reshape(-1, 3))
        errors = compose(inverse(measured), compose(inverse(moved[ends[:, 0]]), moved[ends[:, 1]]))
        errors[:, 2] = wrap_angles(errors[:, 2])
        roots = np.linalg.cholesky(np.array([edge.information for edge in edges]))
        return np.einsum("eji,ej->ei", roots, errors).ravel()

    steps = np.eye(3 * len(poses)) * 1e-6
    jacobian = np.array([(residuals(step) - residuals(-step)) / 2e-6 for step in steps]).T
    free = np.setdiff1d(np.arange(3 * len(poses)), 3 * source + np.arange(3))
    inverted = np.zeros((3 * len(poses),) * 2)
    inverted[np.ix_(free, free)] = np.linalg.inv(jacobian[:, free].T @ jacobian[:, free])
    return inverted[3 * target : 3 * target + 3, 3 * target : 3 * target + 3]


def test_the_drift_of_a_chain_is_that_of_the_composed_motions(chain):
    poses, edges = chain
    (between,) = MotionChain(edges).between(np.array([2, 9]))
    covariance = relative_covariance(poses, edges, [], 2.0, 2, 9)
    np.testing.assert_allclose(covariance, np.linalg.inv(between.information), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("source", "target"), [(0, 11), (3, 7), (8, 1)])
def test_a_graph_with_closures_has_the_covariance_of_its_full_matrix(chain, source, target):
    poses, edges = chain
    closures = [
        MotionEdge(1, 10, relative_pose(poses, 1, 10), np.diag([1e4, 2e4, 1e5])),
        MotionEdge(2, 6, relative_pose(poses, 2, 6), np.diag([1e3, 1.0, 1e5])),
    ]
    covariance = relative_covariance(poses, edges, closures, 2.0, source, target)
    np.testing.assert_allclose(
        covariance, numeric_covariance(poses, [*edges, *closures], source, target), rtol=1e-4, atol=1e-10
    )


def test_a_closure_far_from_the_poses_tells_little(chain):
    poses, edges = chain
    information = np.eye(3) * 1e6
    met = MotionEdge(0, 11, relative_pose(poses, 0, 11), information)
    missed = MotionEdge(0, 11, relative_pose(poses, 0, 11) @ SE2(5.0, 0.0, 0.0), information)
    alone, with_met, with_missed = (
        np.trace(relative_covariance(poses, edges, closures, 2.0, 0, 11)) for closures in ([], [met], [missed])
    )
    assert with_met < 0.01 * alone
    assert with_missed > 0.5 * alone
