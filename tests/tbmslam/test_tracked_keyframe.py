import numpy as np

from tbmslam.laser_scan import LaserScan
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2
from tbmslam.tracked_keyframe import TrackedKeyframe, chain

SCAN = LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.ones(3))


def keyframe(pose, information, variances):
    match = ScanMatch(pose, 0.9, moved=True, information=information)
    return TrackedKeyframe(0, SCAN, SE2.identity(), match, np.array(variances))


def test_a_step_knows_what_surfaces_and_odometry_know():
    """Surfaces that only tell y in the map leave x to the odometry; in the turned keyframe's frame both swap."""
    before = keyframe(SE2(1.0, 2.0, np.pi / 2), None, [1.0, 1.0, 1.0])
    after = keyframe(SE2(1.0, 2.5, np.pi / 2), np.diag([0.0, 1e6, 1e4]), [0.01, 0.01, 0.04])
    (edge,) = chain([before, after])
    np.testing.assert_allclose(edge.T_source_target, (0.5, 0.0, 0.0), atol=1e-12)
    covariance = np.linalg.inv(edge.information)
    floor = 0.004**2
    np.testing.assert_allclose(covariance[0, 0], 1.0 / (1e6 + 100.0) + floor)
    np.testing.assert_allclose(covariance[1, 1], 0.01 + floor)
    np.testing.assert_allclose(covariance[2, 2], 1.0 / (1e4 + 25.0) + 0.001**2)


def test_one_keyframe_has_no_steps():
    assert chain([keyframe(SE2.identity(), None, [1.0, 1.0, 1.0])]) == []
