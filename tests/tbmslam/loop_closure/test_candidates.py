import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.chains import compose_chain
from tbmslam.loop_closure.candidates import ChainDrift, ClosingTargets, DriftGraph
from tbmslam.loop_closure.submap import SubmapConfig
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.optimisation.pose_graph import MotionEdge, relative_pose
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.tracking.surfel_map import SurfelConfig


@pytest.fixture
def targets_of():
    """Return a function that makes the targets of 120 keyframes, one each metre on a circle of 40 m round."""

    def targets(familiar=0.75):
        turns = np.arange(120) * 2.0 * np.pi / 40.0
        radius = 20.0 / np.pi
        poses = np.column_stack((radius * np.cos(turns), radius * np.sin(turns), np.zeros(120)))
        scans = [LaserScan(float(k), -1.5, 0.05, 0.1, 20.0, np.full(60, 2.0)) for k in range(120)]
        keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * len(scans)] * 2)
        hits = DriveHits(ScanHits.of(keyframes, 40.0), poses)
        return poses, ClosingTargets(hits, SubmapConfig(), SurfelConfig(), 12.0, familiar)

    return targets


def test_stretches_become_targets_some_way_after_their_end(targets_of):
    poses, targets = targets_of()
    targets.advance(19)
    assert not len(targets.near(19, poses, 100.0).targets)
    targets.advance(25)
    near = targets.near(25, poses, 100.0)
    assert near.targets.tolist() == [1, 0]
    assert np.all(np.diff(near.distances) >= 0.0)


def test_only_what_was_new_becomes_a_target(targets_of):
    poses, targets = targets_of()
    for keyframe in range(120):
        targets.advance(keyframe)
        targets.note(keyframe, targets.near(keyframe, poses, 0.5).targets.tolist())
    assert max(targets.submap(target).anchor for target in targets.near(119, poses, 100.0).targets) <= 40


def test_what_was_not_found_in_targets_becomes_one(targets_of):
    poses, targets = targets_of()
    for keyframe in range(120):
        targets.advance(keyframe)
        targets.note(keyframe, [])
    assert max(targets.submap(target).anchor for target in targets.near(119, poses, 100.0).targets) > 90


def test_targets_younger_than_a_keyframe_are_not_near_it(targets_of):
    poses, targets = targets_of()
    for keyframe in range(120):
        targets.advance(keyframe)
        targets.note(keyframe, [])
    assert max(targets.submap(target).anchor for target in targets.near(60, poses, 100.0).targets) < 48


def test_the_last_that_were_laid_are_those_of_the_same_targets(targets_of):
    poses, targets = targets_of()
    for keyframe in range(120):
        targets.advance(keyframe)
        targets.note(keyframe, [0] if keyframe == 60 else [])
    near = targets.near(60, poses, 100.0).targets
    middles, latest = targets.anchors(60)
    assert sorted(near.tolist()) == list(range(len(middles)))
    assert middles.tolist() == [sum(targets.stretch(target)) // 2 for target in range(len(middles))]
    assert latest.tolist() == [60, *middles[1:].tolist()]


def test_ways_lead_over_what_was_met(targets_of):
    poses, targets = targets_of()
    targets.advance(42)
    assert targets.path_lengths(42)[0] == pytest.approx(38.0, abs=0.5)
    targets.note(42, [0])
    assert targets.path_lengths(43)[0] == pytest.approx(1.5, abs=0.1)
    assert len(poses) == 120


def test_ways_lead_back_along_the_drive():
    graph = DriftGraph()
    for travelled in (4.0, 8.0, 12.0):
        graph.add_place(travelled)
    assert graph.paths_from(30.0).tolist() == [26.0, 22.0, 18.0]


def test_meeting_a_place_makes_all_ways_over_it_short():
    graph = DriftGraph()
    for travelled in (4.0, 8.0, 12.0):
        graph.add_place(travelled)
    graph.meet(0, 50.0)
    assert graph.paths_from(51.0).tolist() == [1.5, 5.5, 9.5]


def test_a_stretch_between_two_meetings_joins_their_places():
    graph = DriftGraph()
    for travelled in (4.0, 104.0):
        graph.add_place(travelled)
    graph.meet(0, 200.0)
    graph.meet(1, 210.0)
    graph.meet(0, 300.0)
    assert graph.paths_from(300.0).tolist() == [0.5, 0.5 + 11.0]


def test_a_place_learnt_of_later_lies_where_it_was_passed():
    graph = DriftGraph()
    graph.add_place(4.0)
    graph.meet(0, 100.0)
    late = graph.add_place(94.0)
    assert late == 1
    assert graph.paths_from(100.0).tolist() == [0.5, 0.5 + 6.5]


def test_memory_grows_with_the_places_not_with_the_rounds():
    graph = DriftGraph()
    for place in range(10):
        graph.add_place(4.0 * place)
    for travelled in range(40, 40040, 4):
        graph.meet(travelled // 4 % 10, float(travelled))
    assert len(graph._edges) == 10
    assert graph.paths_from(40036.0).max() <= 0.5 + 5 * 5.0


def test_drift_is_that_of_the_composed_motions(generator):
    poses = np.cumsum(generator.normal(0.2, 0.4, (40, 3)), axis=0)
    informations = [np.diag(generator.uniform(1e3, 1e5, 3)) for _ in range(39)]
    chain = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), informations[k]) for k in range(39)]
    _, ((covariance),) = compose_chain(
        np.array([edge.T_source_target for edge in chain]), np.linalg.inv(np.array(informations)), np.array([3, 37])
    )
    drift = ChainDrift(poses, np.linalg.inv(np.array(informations)))
    positions, headings = drift.deviations(np.array([3]), np.array([37]))
    np.testing.assert_allclose(positions, np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    np.testing.assert_allclose(headings, np.sqrt(covariance[2, 2]))


def test_the_largest_deviation_bounds_those_from_all_keyframes_between(generator):
    poses = np.cumsum(generator.normal(0.2, 0.4, (40, 3)), axis=0)
    roots = generator.normal(0.0, 0.01, (39, 3, 3))
    drift = ChainDrift(poses, roots @ np.swapaxes(roots, 1, 2))
    between = np.arange(3, 37)
    positions, _ = drift.deviations(between, np.full(len(between), 37))
    bound = drift.largest_deviation(3, 37)
    assert positions[0] == positions.max()
    assert positions[0] <= bound <= math.sqrt(2.0) * positions[0]
