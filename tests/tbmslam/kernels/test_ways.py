import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tbmslam.kernels.ways import distances_to_stretches, shortest_ways


def test_distances_are_to_the_nearest_of_each_stretch(generator):
    poses = generator.normal(size=(20, 3))
    firsts, lasts = np.array([0, 5, 19]), np.array([4, 12, 19])
    expected = [
        np.hypot(*(poses[first : last + 1, :2] - poses[7, :2]).T).min()
        for first, last in zip(firsts, lasts, strict=True)
    ]
    np.testing.assert_allclose(distances_to_stretches(poses, 7, firsts, lasts), expected)


def test_ways_are_the_shortest_in_the_graph(generator):
    travelled = np.cumsum(generator.random(200))
    bridges = generator.integers(0, 200, (12, 2))
    sources, targets = np.concatenate((np.column_stack((np.arange(199), np.arange(1, 200))), bridges)).T
    lengths = np.concatenate((np.diff(travelled), np.full(12, 0.5)))
    graph = coo_array((200, 200)).tolil()
    for source, target, length in zip(sources, targets, lengths, strict=True):
        if source != target:
            graph[source, target] = min(length, graph[source, target] or np.inf)
    for start in (0, 77, 199):
        expected = dijkstra(graph.tocsr(), directed=False, indices=[start])[0]
        np.testing.assert_allclose(shortest_ways(travelled, bridges, 0.5, start), expected)


def test_without_bridges_the_way_is_the_drive():
    travelled = np.array([0.0, 1.0, 3.0])
    assert shortest_ways(travelled, np.zeros((0, 2), dtype=np.int64), 0.5, 1).tolist() == [1.0, 0.0, 2.0]
