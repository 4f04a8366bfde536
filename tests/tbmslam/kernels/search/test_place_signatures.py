import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.search.place_signatures import FACINGS, all_products, pair_signature, spread_points


def scene(generator, count):
    angles = generator.uniform(-np.pi, np.pi, count)
    return generator.uniform(-8.0, 8.0, (count, 2)), np.column_stack((np.cos(angles), np.sin(angles)))


def test_signature_is_that_of_its_plain_twin(generator):
    points, normals = scene(generator, 60)
    shares = np.zeros((10, FACINGS))
    first, second = np.tril_indices(60, -1)
    slots = np.hypot(*(points[first] - points[second]).T).astype(int)
    facings = np.searchsorted([-0.85, -0.3, 0.3, 0.85], (normals[first] * normals[second]).sum(axis=1))
    np.add.at(shares, (slots[slots < 10], facings[slots < 10]), 1.0)
    np.testing.assert_allclose(pair_signature(points, normals, 1.0, 10), np.sqrt(shares / shares.sum()).ravel())


def test_signature_does_not_depend_on_the_frame(generator):
    points, normals = scene(generator, 60)
    pose = SE2(30.0, -12.0, 2.1)
    moved = pair_signature(pose.apply(points), SE2(0.0, 0.0, pose.theta).apply(normals), 1.0, 24)
    assert moved @ pair_signature(points, normals, 1.0, 24) > 0.999


def test_the_first_point_of_each_cell_is_taken():
    points = np.array([[0.1, 0.1], [0.2, 0.3], [1.1, 0.1], [-0.1, 0.1], [1.3, 0.2]])
    assert spread_points(points, 1.0, 10).tolist() == [0, 2, 3]
    assert spread_points(points, 1.0, 2).tolist() == [0, 2]
    assert len(spread_points(points[:0], 1.0, 2)) == 0


def test_products_of_whole_numbers_are_exact(generator):
    """Added up in any order, as long as they stay below 2**24."""
    ones, others = (generator.integers(0, 300, (count, 90)) for count in (7, 4))
    products = all_products(ones.astype(np.float32), others.astype(np.float32))
    assert products.tolist() == (ones @ others.T).tolist()
