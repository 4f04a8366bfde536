import numpy as np
import pytest

from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.loop_closure.candidates import ClosingTargets
from tbmslam.loop_closure.drift_test import DriftTest
from tbmslam.loop_closure.loop_closer import LoopClosingConfig, PlacedBundle
from tbmslam.map.scan_hits import DriveHits
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose
from tbmslam.slam import Slam
from tbmslam.tracking.surfel_map import SurfelConfig
from tests.tbmslam.drifting_drive import drifting_keyframes

CONFIG = LoopClosingConfig()
PRECISE = np.diag([0.02**2, 0.02**2, 0.004**2])
DOOR = SE2(2.5, 0.0, 0.0)
"""One door further along a corridor."""


@pytest.fixture(scope="module")
def office(drive_in):
    """Return true laser poses of keyframes, their scans, and keyframes that see the start again."""
    true, _, scans = drifting_keyframes(drive_in("office", None, seed=1), 0.0, 0.4)
    travelled = np.cumsum(np.hypot(*np.diff(true[:, :2], axis=0, prepend=true[:1, :2]).T))
    seen = np.flatnonzero((travelled > 30.0) & (np.hypot(*(true[:, :2] - true[8, :2]).T) < 3.0))
    return true, scans, seen[:12:3]


def is_allowed(office, poses, deviation, error):
    """Return whether the stops of a drive may be off by a motion from where they truly are in the start's submap.

    `deviation` is that of each motion between keyframes [m]; in heading it is a third [rad].
    """
    true, scans, stops = office
    hits = DriveHits(scans, poses)
    targets = ClosingTargets(hits, CONFIG.submap, SurfelConfig(), CONFIG.min_gap, CONFIG.familiar)
    targets.advance(int(stops[-1]))
    submap, elected = targets.submap(0), []
    for stop in stops.tolist():
        place = relative_pose(true, submap.anchor, stop) @ error
        fit = submap.fit(hits.bundle(stop, CONFIG.bundle, CONFIG.match_points), place)
        elected.append(PlacedBundle(stop, 0, submap.anchor, place, np.eye(3), 0.5, fit.violated))
    information = np.diag(np.array([deviation, deviation, deviation / 3]) ** -2.0)
    chain = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), information) for k in range(len(poses) - 1)]
    test = DriftTest(
        MotionChain.of(chain), targets, hits, CONFIG.graph.robust_width, CONFIG.bundle, CONFIG.match_points
    )
    return test.allows(elected, PRECISE, poses, [])


def test_a_place_within_the_drift_is_allowed(office):
    assert is_allowed(office, office[0], 0.003, SE2(0.1, 0.05, 0.0))


def test_a_place_beyond_the_drift_is_refused_where_nothing_contradicts_the_drive(office):
    assert not is_allowed(office, office[0], 0.003, DOOR)


def test_a_drive_that_may_have_drifted_so_far_allows_it(office):
    assert is_allowed(office, office[0], 0.05, DOOR)


def test_a_true_place_is_allowed_after_an_unnoticed_slip(office):
    """The motions exclude the true place, but by them the laser looks through walls."""
    true, _, stops = office
    slipped = true.copy()
    half = int(stops[0]) // 2
    slipped[half:] = compose(np.array([[3.0, -2.0, 0.0]]), true[half:])
    assert is_allowed(office, slipped, 0.003, SE2.identity())


@pytest.mark.slow
def test_equal_doors_close_a_false_loop_where_drift_is_not_tested(drive_in, monkeypatch):
    """Ablation, with a corridor that comes back to its start from where no laser was before."""
    robot = drive_in("hospital", None, seed=305)

    def ate():
        slam = Slam()
        for reading in robot.readings:
            slam.process(reading)
        return align_trajectories(robot.truth, slam.finish().drives[0].trajectory).ate_m

    assert ate() < 0.03
    monkeypatch.setattr(DriftTest, "allows", lambda *_: True)
    assert ate() > 1.0
