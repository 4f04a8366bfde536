import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.surfels.surfels import CELLS
from tbmslam.sensing.laser_scan import Hits
from tbmslam.tracking.surfel_map import SurfelConfig, SurfelMap

SEARCH = 4.0, 0.1, np.inf, np.array([12.0, 4.0]), 400, 8


def corner(generator):
    """The hits of two walls that meet at a right angle, seen from 3 m away."""
    along, noise = np.linspace(-3.0, 3.0, 150), generator.normal(0.0, 0.003, 150)
    points = np.vstack((np.column_stack((along, 3.0 + noise)), np.column_stack((3.0 + noise, along))))
    normals = np.repeat([[0.0, -1.0], [-1.0, 0.0]], 150, axis=0)
    return Hits(points, normals)


def test_a_map_with_room_from_the_begin_is_that_which_grew(generator):
    scans = [(corner(generator), SE2(0.4 * k, 0.1 * k, 0.05 * k)) for k in range(5)]
    grown = SurfelMap(SurfelConfig())
    assert grown.slots == CELLS
    for hits, pose in scans:
        grown.insert(hits, pose)
    roomy = SurfelMap(SurfelConfig(), slots=grown.slots)
    for hits, pose in scans:
        roomy.insert(hits, pose)
    assert roomy.slots == grown.slots > CELLS
    hits, guess = corner(generator), SE2(0.43, 0.08, 0.06)
    one, other = (each.register(hits, guess, guess, np.eye(3), SEARCH) for each in (grown, roomy))
    assert one.pose == other.pose
    assert one.matched == other.matched > 0.5
    np.testing.assert_array_equal(one.hessian, other.hessian)
