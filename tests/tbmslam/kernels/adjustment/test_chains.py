import itertools

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.chains import compose_chain


def plain(motions, covariances, nodes):
    """Compose by the group, and carry covariances by the adjoint of what is still to come."""
    composed, summed = [], []
    for first, last in itertools.pairwise(nodes):
        motion, covariance = SE2.identity(), np.zeros((3, 3))
        for k in reversed(range(first, last)):  # from the end, unlike the kernel
            rest = motion.inverse()
            adjoint = np.eye(3)
            adjoint[:2, :2] = rest.matrix()[:2, :2]
            adjoint[:2, 2] = (rest.y, -rest.x)  # Sola et al., eq. 159
            covariance = covariance + adjoint @ covariances[k] @ adjoint.T
            motion = SE2.from_array(motions[k]) @ motion
        composed.append(motion)
        summed.append(covariance)
    return np.array(composed), np.array(summed)


@pytest.fixture
def drive():
    generator = np.random.default_rng(5)
    motions = generator.normal(0.0, (0.5, 0.2, 0.8), (30, 3))
    halves = generator.normal(0.0, 0.1, (30, 3, 3))
    return motions, halves @ halves.transpose(0, 2, 1)


def test_chains_are_products_by_the_group(drive):
    nodes = np.array([0, 1, 4, 4, 17, 30])
    composed, summed = compose_chain(*drive, nodes)
    expected, covariances = plain(*drive, nodes)
    np.testing.assert_allclose(composed[:, :2], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * composed[:, 2]), np.exp(1j * expected[:, 2]), atol=1e-9)
    np.testing.assert_allclose(summed, covariances, atol=1e-9)
    assert np.all((composed[:, 2] >= -np.pi) & (composed[:, 2] < np.pi))


def test_one_step_keeps_its_covariance(drive):
    motions, covariances = drive
    composed, summed = compose_chain(motions, covariances, np.array([6, 7]))
    np.testing.assert_allclose(composed[0, :2], motions[6, :2])
    np.testing.assert_allclose(summed[0], covariances[6])


def test_one_node_has_no_motion(drive):
    composed, summed = compose_chain(*drive, np.array([3]))
    assert composed.shape == (0, 3)
    assert summed.shape == (0, 3, 3)
