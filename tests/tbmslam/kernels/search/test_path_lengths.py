import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tbmslam.kernels.search.path_lengths import nearest_stretches, revisited, shortest_paths


def test_distances_are_to_the_nearest_of_each_stretch(generator):
    poses = generator.normal(size=(20, 3))
    firsts, lasts = np.array([0, 5, 19]), np.array([4, 12, 19])
    expected = [
        np.hypot(*(poses[first : last + 1, :2] - poses[7, :2]).T).min()
        for first, last in zip(firsts, lasts, strict=True)
    ]
    near, distances = nearest_stretches(poses, 7, firsts, lasts, 100.0, 100.0)
    np.testing.assert_array_equal(near, np.argsort(expected))
    np.testing.assert_allclose(distances, np.sort(expected))


def test_far_stretches_are_passed_over():
    poses = np.column_stack((np.arange(20.0), np.zeros(20)))
    firsts, lasts = np.array([1, 11]), np.array([5, 15])
    near, distances = nearest_stretches(poses, 0, firsts, lasts, 5.0, 4.0)
    assert near.tolist() == [0]
    assert distances.tolist() == [1.0]
    for longest in (4.0, 10.0):  # told by its middle, and by all of its poses
        assert nearest_stretches(poses, 0, firsts[::-1].copy(), lasts[::-1].copy(), 5.0, longest)[0].tolist() == [1]


def test_ways_are_the_shortest_in_the_graph(generator):
    edges = np.vstack((np.column_stack((np.arange(199), np.arange(1, 200))), generator.integers(0, 200, (12, 2))))
    lengths = np.concatenate((generator.random(199), np.full(12, 0.5)))
    graph = coo_array((200, 200)).tolil()
    for (source, target), length in zip(edges, lengths, strict=True):
        if source != target:
            graph[source, target] = min(length, graph[source, target] or np.inf)
    for start in (0, 77, 199):
        expected = dijkstra(graph.tocsr(), directed=False, indices=[start])[0]
        np.testing.assert_allclose(shortest_paths(200, edges, lengths, start), expected)


def test_what_no_edge_reaches_is_infinitely_far():
    assert shortest_paths(3, np.array([[0, 1]]), np.array([2.0]), 0).tolist() == [0.0, 2.0, np.inf]


def test_poses_are_shown_by_enough_before_them(generator):
    places = generator.uniform((-2.0, -8.0), (2.0, 8.0), (400, 2))  # longer than wide, so that rows and columns differ
    poses = np.column_stack((places, generator.uniform(-np.pi, np.pi, 400)))
    expected = np.zeros(400, dtype=bool)
    for k in range(100, 400):
        turned = np.abs(np.angle(np.exp(1j * (poses[:k, 2] - poses[k, 2]))))
        near = (np.hypot(*(poses[:k, :2] - poses[k, :2]).T) <= 1.0) & (turned <= 0.8) & ~expected[:k]
        expected[k] = near.sum() >= 3
    np.testing.assert_array_equal(revisited(poses, 100, 1.0, 0.8, 3), expected)
    assert 20 < expected.sum() < 280
