import numpy as np
import pytest
from scipy.optimize import approx_fprime

from tbmslam.geometry.se2 import SE2, compose, inverse, wrap_angles
from tbmslam.optimisation.graph_optimisation import optimise, relative_covariance
from tbmslam.optimisation.pose_graph import EdgeArrays, MotionChain, MotionEdge, edge_errors, relative_pose

SURE = np.diag([1e4, 1e4, 1e5])


def square(count=40, drift=0.0):
    """Poses around a square, each step turned a little too far, and the true poses."""
    true, drifted = [SE2.identity()], [SE2.identity()]
    for number in range(count):
        step = SE2(1.0, 0.0, np.pi / 2 if number % 10 == 9 else 0.0)
        true.append(true[-1] @ step)
        drifted.append(drifted[-1] @ SE2(step.x, step.y, step.theta + drift))
    return np.array(true), np.array(drifted)


def chain_of(poses, information):
    return [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), information) for k in range(len(poses) - 1)]


def test_a_closure_takes_the_drift_back():
    true, drifted = square(drift=0.003)
    chain = chain_of(drifted, np.diag([1e4, 1e4, 1e4]))
    closure = MotionEdge(0, 40, SE2.identity(), SURE)
    solved = optimise(drifted, EdgeArrays.of(chain), [closure], 2.0)
    assert np.hypot(*(drifted - true)[40, :2]) > 0.5
    assert np.hypot(*(solved - true)[40, :2]) < 0.05
    assert np.hypot(*(solved - true)[:, :2].T).max() < 0.5 * np.hypot(*(drifted - true)[:, :2].T).max()
    np.testing.assert_allclose(solved[0], 0.0, atol=1e-6)


def test_a_false_closure_does_not_bend_the_map():
    true, _ = square()
    chain = chain_of(true, SURE)
    good = [MotionEdge(k, 40 - k, relative_pose(true, k, 40 - k), SURE) for k in range(5)]
    false = MotionEdge(0, 20, SE2.identity(), SURE)
    solved = optimise(true, EdgeArrays.of(chain), [*good, false], 2.0)
    assert np.hypot(*(solved - true)[:, :2].T).max() < 0.05
    assert edge_errors([false], solved)[0] > 100.0


def robust_error(poses, chain, closures, width):
    """Half the squared deviations, each motion alone and slowly; those of closures as Cauchy weighs them."""
    total = 0.0
    for edge in (*chain, *closures):
        error = np.array(edge.T_source_target.inverse() @ relative_pose(poses, edge.source, edge.target))
        square = error @ edge.information @ error
        total += 0.5 * (square if edge in chain else width**2 * np.log1p(square / width**2))
    return total


def test_no_poses_nearby_agree_better(generator):
    _, drifted = square(count=12, drift=0.01)
    root = generator.normal(0.0, 1.0, (3, 3))
    chain = chain_of(drifted, 100.0 * (root @ root.T + np.eye(3)))
    closures = [MotionEdge(0, 12, SE2.identity(), SURE), MotionEdge(2, 9, SE2(4.0, 1.0, 0.5), SURE)]
    solved = optimise(drifted, EdgeArrays.of(chain), closures, 2.0, precision=1e-9)

    def error(changes):
        moved = solved.copy()
        moved[1:] += changes.reshape(-1, 3)
        return robust_error(moved, chain, closures, 2.0)

    slopes = approx_fprime(np.zeros(36), error, 1e-7)
    bends = np.array(
        [(error(1e-4 * unit) + error(-1e-4 * unit) - 2.0 * error(0.0 * unit)) / 1e-8 for unit in np.eye(36)]
    )
    assert np.abs(slopes / bends).max() < 1e-5  # how far each number is from its best, with the others held [m, rad]


def test_poses_that_are_all_wrong_never_agree_less_afterwards(generator):
    true, _ = square(count=10)
    chain, closures = chain_of(true, np.diag([1.0, 1.0, 1.0])), [MotionEdge(0, 10, SE2.identity(), SURE)]
    for _ in range(20):
        lost = np.vstack([true[:1], generator.uniform(-20.0, 20.0, (10, 3))])
        solved = optimise(lost, EdgeArrays.of(chain), closures, 2.0)
        assert robust_error(solved, chain, closures, 2.0) < robust_error(lost, chain, closures, 2.0)


def test_maps_without_a_chain_follow_their_closures(generator):
    true = generator.uniform(-10.0, 10.0, (9, 3))
    pairs = [(0, 5), (5, 2), (2, 7), (7, 1), (1, 3), (3, 8), (8, 4), (4, 6), (6, 0), (2, 6)]
    edges = [MotionEdge(one, other, relative_pose(true, one, other), SURE) for one, other in pairs]
    guess = true + np.vstack([np.zeros(3), generator.normal(0.0, [0.3, 0.3, 0.05], (8, 3))])
    np.testing.assert_allclose(optimise(guess, EdgeArrays.of([]), edges, 2.0)[:, :2], true[:, :2], atol=1e-3)


def test_no_poses_are_no_trouble():
    assert len(optimise(np.zeros((0, 3)), EdgeArrays.of([]), [], 2.0)) == 0


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
    information = MotionChain.of(edges).between(np.array([2, 9])).informations[0]
    covariance = relative_covariance(poses, EdgeArrays.of(edges), [], 2.0, 2, 9)
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("source", "target"), [(0, 11), (3, 7), (8, 1)])
def test_a_graph_with_closures_has_the_covariance_of_its_full_matrix(chain, source, target):
    poses, edges = chain
    closures = [
        MotionEdge(1, 10, relative_pose(poses, 1, 10), np.diag([1e4, 2e4, 1e5])),
        MotionEdge(2, 6, relative_pose(poses, 2, 6), np.diag([1e3, 1.0, 1e5])),
    ]
    covariance = relative_covariance(poses, EdgeArrays.of(edges), closures, 2.0, source, target)
    np.testing.assert_allclose(
        covariance, numeric_covariance(poses, [*edges, *closures], source, target), rtol=1e-4, atol=1e-10
    )


def test_a_closure_far_from_the_poses_tells_little(chain):
    poses, edges = chain
    information = np.eye(3) * 1e6
    met = MotionEdge(0, 11, relative_pose(poses, 0, 11), information)
    missed = MotionEdge(0, 11, relative_pose(poses, 0, 11) @ SE2(5.0, 0.0, 0.0), information)
    alone, with_met, with_missed = (
        np.trace(relative_covariance(poses, EdgeArrays.of(edges), closures, 2.0, 0, 11))
        for closures in ([], [met], [missed])
    )
    assert with_met < 0.01 * alone
    assert with_missed > 0.5 * alone
