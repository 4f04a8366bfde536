import numpy as np
import pytest

from merging.config.groups import JointConfig
from merging.joint_slam import Track, _determined
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.sensing.laser_scan import LaserScan

CONFIG = JointConfig()
MEASURED = np.array([0.5, 0.01, 0.02])


def track(*, measured):
    """Forty metres out and back in the middle of a round room."""
    along = np.concatenate((np.arange(0.0, 20.0, 0.5), np.arange(20.0, 0.0, -0.5)))
    poses = np.column_stack((along, np.zeros_like(along), np.zeros_like(along)))
    scan = LaserScan(0.0, -3.0, 0.1, 0.1, 9.0, np.full(61, 5.0))
    keyframes = Keyframes.from_scans(
        [scan] * len(along), [SE2.from_array(pose) for pose in poses], [SE2.identity()] * len(along)
    )
    count = len(along) - 1
    motions = DriveMotions(np.tile(MEASURED, (count, 1)), np.tile(np.eye(3), (count, 1, 1))) if measured else None
    drive = Drive("robot", Trajectory(np.arange(len(along), dtype=np.float64), poses), keyframes, motions=motions)
    return Track("map", drive, SE2(1.0, 2.0, 0.5), CONFIG.submap)


@pytest.fixture(scope="module")
def told():
    return track(measured=True)


@pytest.fixture(scope="module")
def untold():
    return track(measured=False)


def test_a_drive_is_chained_by_what_was_measured(told):
    edges = told.chain(10, CONFIG)
    assert [(edge.source, edge.target) for edge in edges] == [(10 + i, 11 + i) for i in range(len(told.sensors) - 1)]
    assert all(edge.T_source_target == pytest.approx(tuple(MEASURED)) for edge in edges)


def test_where_nothing_measured_was_kept_poses_stand_for_it_and_for_the_loops(untold):
    edges = untold.chain(0, CONFIG)
    steps = [edge for edge in edges if edge.target == edge.source + 1]
    assert len(steps) == len(untold.sensors) - 1
    assert all(abs(abs(edge.T_source_target.x) - 0.5) < 1e-9 for edge in steps)
    # On the way back it comes near its way out: there every two stops, but for neighbours, are held together.
    stops, xy = untold.stops(CONFIG.stiffness_step_m), untold.sensors[:, :2]
    crossings = {
        (first, second)
        for number, first in enumerate(stops)
        for second in stops[number + 2 :]
        if np.hypot(*(xy[second] - xy[first])) < CONFIG.stiffness_reach_m
    }
    assert len(crossings) > 10
    assert {(edge.source, edge.target) for edge in edges[len(steps) :]} == crossings


@pytest.mark.parametrize("step", [0.7, 2.5])
def test_stops_are_a_step_apart(told, step):
    apart = np.diff(told.hits.travelled[told.stops(step)])
    assert step - 0.5 <= apart.min() <= apart.max() <= step + 0.5


def test_an_undetermined_direction_has_no_information():
    turn = SE2(0.0, 0.0, 0.4).matrix()
    open_along, shut = (turn @ np.diag([along, 1e6, 1e5]) @ turn.T for along in (10.0, 5e5))
    np.testing.assert_array_equal(_determined(shut, CONFIG), shut)
    kept = _determined(open_along, CONFIG)
    np.testing.assert_allclose(turn.T @ kept @ turn, np.diag([0.0, 1e6, 1e5]), atol=1e-6)


def test_a_bundle_is_registered_to_earlier_visits_of_its_own_drive(told, untold):
    back = len(told.sensors) - 1
    own = told.others(back, told, CONFIG)
    travelled = told.hits.travelled
    assert 0 in own
    assert all(travelled[back] - travelled[told.submaps[k].last] > CONFIG.min_gap_m for k in own)
    assert len(own) < len(told.submaps)
    assert told.others(0, told, CONFIG) == []
    assert untold.others(back, untold, CONFIG) == []
    assert told.others(0, untold, CONFIG) == list(range(len(untold.submaps)))
