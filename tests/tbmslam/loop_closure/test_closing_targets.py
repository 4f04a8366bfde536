import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.loop_closure.closing_targets import ClosingTargets
from tbmslam.loop_closure.drive_hits import DriveHits
from tbmslam.loop_closure.submap import SubmapConfig
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
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


def test_ways_lead_over_what_was_met(targets_of):
    poses, targets = targets_of()
    targets.advance(42)
    assert targets.ways(42)[0] == pytest.approx(38.0, abs=0.5)
    targets.note(42, [0])
    assert targets.ways(43)[0] == pytest.approx(1.5, abs=0.1)
    assert len(poses) == 120
