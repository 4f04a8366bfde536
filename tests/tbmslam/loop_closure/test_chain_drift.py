import numpy as np

from tbmslam.kernels.adjustment.chains import compose_chain
from tbmslam.loop_closure.chain_drift import ChainDrift
from tbmslam.optimisation.pose_graph import MotionEdge, relative_pose


def test_drift_is_that_of_the_composed_motions(generator):
    poses = np.cumsum(generator.normal(0.2, 0.4, (40, 3)), axis=0)
    informations = [np.diag(generator.uniform(1e3, 1e5, 3)) for _ in range(39)]
    chain = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), informations[k]) for k in range(39)]
    _, ((covariance),) = compose_chain(
        np.array([edge.T_source_target for edge in chain]), np.linalg.inv(np.array(informations)), np.array([3, 37])
    )
    drift = ChainDrift(poses, chain)
    positions, headings = drift.deviations(np.array([3]), np.array([37]))
    np.testing.assert_allclose(positions, np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    np.testing.assert_allclose(headings, np.sqrt(covariance[2, 2]))
