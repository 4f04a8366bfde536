import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure.far_search import PlaceIndex, place_signature
from tbmslam.sensing.laser_scan import Hits

_HERE = SE2.identity()


def room(width, depth, pose=_HERE):
    """Return the hits of a room's four walls, as seen from a pose."""
    along, across = np.arange(0.1, width, 0.1), np.arange(0.1, depth, 0.1)
    walls = [
        (np.column_stack((along, np.zeros_like(along))), (0.0, 1.0)),
        (np.column_stack((along, np.full_like(along, depth))), (0.0, -1.0)),
        (np.column_stack((np.zeros_like(across), across)), (1.0, 0.0)),
        (np.column_stack((np.full_like(across, width), across)), (-1.0, 0.0)),
    ]
    points = np.concatenate([wall for wall, _ in walls])
    normals = np.concatenate([np.tile(normal, (len(wall), 1)) for wall, normal in walls])
    return Hits(pose.apply(points), SE2(0.0, 0.0, pose.theta).apply(normals))


def test_a_place_is_found_again_in_another_frame():
    index = PlaceIndex()
    for size in range(100):
        index.add(place_signature(room(3.0 + 0.1 * size, 4.0)))
    assert len(index) == 100
    seen = place_signature(room(7.0, 4.0, SE2(200.0, -30.0, 1.0)))
    found = index.likeliest(seen, np.zeros(100), 5).tolist()
    assert 40 in found
    assert max(abs(place - 40) for place in found) < 10


def test_what_is_known_otherwise_counts():
    index = PlaceIndex()
    for _ in range(3):
        index.add(place_signature(room(5.0, 4.0)))
    prior = np.array([-2.0, -np.inf, -1.0])
    assert index.likeliest(place_signature(room(5.0, 4.0)), prior, 3).tolist() == [2, 0]
    assert index.likeliest(place_signature(room(5.0, 4.0)), prior[:1], 3).tolist() == [0]
