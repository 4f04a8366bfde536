"""Beams blocked by the robot are left out, and told once."""

import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.monitoring.blocked_beams import BlockedBeamsConfig
from tbmslam.monitoring.incidents import Incidents
from tbmslam.monitoring.laser_view import LaserView
from tbmslam.sensing.laser_scan import LaserScan

ANGLES = -1.0 + 0.02 * np.arange(100)
COVERED = slice(0, 20)


def drive(turning, until=40, config=None):
    """Drive through a hall with 20 beams covered."""
    incidents = Incidents()
    view = LaserView(config or BlockedBeamsConfig(), incidents)
    rng = np.random.default_rng(2)
    for k in range(60):
        pose = SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k) * turning)
        ranges = 8.0 + rng.normal(0.0, 0.005, 100)
        if k < until:
            ranges[COVERED] = 0.6 + rng.normal(0.0, 0.005, 20)
        scan = LaserScan(float(k), -1.0, 0.02, 0.02, 30.0, ranges)
        cleaned = view.cleaned(scan)
        view.look(pose)
    return view, [incident.text(0.0) for incident in incidents], cleaned


def test_it_is_told_once_with_the_time():
    view, told, cleaned = drive(1.0)
    assert told == ["at 0.0 s: something on the robot, or along with it, blocks 20% of the beams, -57 to -36°"]
    assert view.were_any_blocked()
    assert np.isfinite(cleaned.ranges).all()
    early = view.cleared(LaserScan(3.0, -1.0, 0.02, 0.02, 30.0, np.full(100, 0.6)))
    assert np.isnan(early.ranges[COVERED]).all()


def test_only_turning_tells():
    assert drive(0.0)[1] == []


@pytest.mark.parametrize("step", [math.radians(0.25), -math.radians(0.25), 1e-9, 1e-320])
def test_a_fan_narrower_than_what_counts_as_beside(step):
    incidents, rng = Incidents(), np.random.default_rng(2)
    view = LaserView(BlockedBeamsConfig(), incidents)
    for k in range(40):
        ranges = 8.0 + rng.normal(0.0, 0.005, 30)
        ranges[:10] = 0.25
        scan = LaserScan(float(k), 0.0, step, 0.02, 30.0, ranges)
        cleaned = view.cleaned(scan)
        view.look(SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k)))
    assert np.flatnonzero(np.isnan(cleaned.ranges)).tolist() == list(range(10))
    assert len(incidents) == 1


def test_a_single_beam_without_a_step():
    incidents, config = Incidents(), BlockedBeamsConfig(fewest=1)
    view = LaserView(config, incidents)
    for k in range(40):
        pose = SE2(0.3 * k, 0.0, 0.8 * math.sin(0.5 * k))
        cleaned = view.cleaned(LaserScan(float(k), 0.0, 0.0, 0.02, 30.0, np.full(1, 0.25)))
        view.look(pose)
    assert np.isnan(cleaned.ranges).all()
    assert len(incidents) == 1


def told_by(blocked_at, stamps):
    """Return what is told, where beams are blocked at some times."""
    incidents, rng = Incidents(), np.random.default_rng(2)
    view = LaserView(BlockedBeamsConfig(), incidents)
    for k, stamp in enumerate(stamps):
        ranges = 8.0 + rng.normal(0.0, 0.005, 100)
        for beams, near in blocked_at(k):
            ranges[beams] = near
        pose = SE2(0.31 * k, 0.0, 0.8 * math.sin(0.5 * k))
        view.cleaned(LaserScan(float(stamp), -1.0, 0.02, 0.02, 30.0, ranges))
        view.look(pose)
    return [incident.text(0.0) for incident in incidents]


def test_a_post_that_shakes_now_and_then_is_told_once():
    shaking = told_by(lambda k: [(COVERED, 0.7 if k % 100 == 99 else 0.6)], range(2000))
    assert shaking == ["at 0.0 s: something on the robot, or along with it, blocks 20% of the beams, -57 to -36°"]


def test_what_comes_back_after_a_while_is_told_again():
    told = told_by(lambda k: [] if 100 <= k < 300 else [(COVERED, 0.6)], range(400))
    assert [text.split(":")[0] for text in told] == ["at 0.0 s", "at 300.0 s"]


def test_what_stays_is_not_told_again_after_a_gap_in_the_recording():
    other = slice(60, 80)
    stamps = [k if k < 100 else k + 500 for k in range(200)]
    told = told_by(lambda k: [(COVERED, 0.6)] + ([(other, 0.5)] if k >= 100 else []), stamps)
    assert [text.rsplit(", ", 1)[1] for text in told] == ["-57 to -36°", "11 to 33°"]
