"""Scans among trees: single hits on trunks, hardly ever two on the same one."""

import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2, wrap_angle
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.slam import Slam
from tbmslam.tracking.scan_to_scan import RecentScans, motion_between

BEAMS = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 181)


def trees(seed):
    """Return centres (N, 2) of trunks about a path of 40 m and around its turn [m]."""
    centres = np.random.default_rng(seed).uniform((-20.0, -25.0), (50.0, 40.0), (260, 2))
    path = np.array([(pose.x, pose.y) for pose in walk()])
    return centres[np.linalg.norm(centres[:, None] - path, axis=2).min(axis=1) > 1.0]


def walk():
    """Return poses of a robot that goes straight, turns left by 90 degrees within two seconds, and goes on."""
    poses = [SE2.identity()]
    for turn in (*[0.0] * 50, *[math.pi / 8] * 4, *[0.0] * 50):
        poses.append(poses[-1] @ SE2(0.25, 0.0, turn))
    return poses


def ranges_at(pose, centres, radius=0.12, farthest=25.0, noise=None):
    """Return what the laser measures (181,): the nearest trunk in each beam, else inf."""
    x, y = (centres - [pose.x, pose.y]).T
    headings = pose.theta + BEAMS[:, None]
    along, across = x * np.cos(headings) + y * np.sin(headings), y * np.cos(headings) - x * np.sin(headings)
    hit = (np.abs(across) < radius) & (along > 0.0)
    away = np.where(hit, along - np.sqrt(np.maximum(radius**2 - across**2, 0.0)), np.inf).min(axis=1)
    away += noise.normal(0.0, 0.02, len(away)) if noise is not None else 0.0
    return np.where(away < farthest, away, np.inf)


def points_at(pose, centres, noise=None):
    ranges = ranges_at(pose, centres, noise=noise)
    seen = np.isfinite(ranges)
    return ranges[seen, None] * np.column_stack((np.cos(BEAMS[seen]), np.sin(BEAMS[seen])))


def readings(seed):
    """Return readings without odometry along the walk, two a second."""
    noise, centres = np.random.default_rng(seed), trees(seed)
    for k, pose in enumerate(walk()):
        ranges = ranges_at(pose, centres, noise=noise)
        scan = LaserScan(0.5 * k, BEAMS[0], BEAMS[1] - BEAMS[0], 0.1, 30.0, ranges)
        yield Reading(scan, None)


def errors(seed):
    """Return the errors of position [m] and heading [rad] at the end of a walk."""
    slam = Slam()
    for reading in readings(seed):
        slam.process(reading)
    poses = slam.finish().drives[0].trajectory.poses
    end = SE2.from_array(poses[0]).to(SE2.from_array(poses[-1]))
    return math.hypot(end.x - walk()[-1].x, end.y - walk()[-1].y), abs(wrap_angle(end.theta - walk()[-1].theta))


@pytest.mark.parametrize("motion", [(0.3, 0.0, 0.0), (0.2, -0.05, 0.35), (0.0, 0.1, -0.5), (0.45, 0.1, 0.1)])
def test_the_motion_between_two_scans_among_trees_is_found_within_its_deviations(motion):
    noise, centres = np.random.default_rng(1), trees(1)
    first, second = SE2(3.0, 1.0, 0.2), SE2(3.0, 1.0, 0.2) @ SE2(*motion)
    found = motion_between(points_at(first, centres, noise), points_at(second, centres, noise), SE2(0.2, 0.0, 0.0))
    error = SE2(*motion).to(found.motion)
    assert math.hypot(error.x, error.y) < 2.0 * found.deviations[0] < 0.2
    assert abs(error.theta) < 2.0 * found.deviations[1] < 0.05


def test_few_points_have_large_deviations():
    noise, centres = np.random.default_rng(1), trees(1)
    before, now = (points_at(SE2(x, 0.0, 0.0), centres, noise) for x in (0.0, 0.25))
    few, many = (motion_between(before, now[::step], SE2.identity()) for step in (10, 1))
    assert few.deviations[0] > 2.0 * many.deviations[0]
    assert few.deviations[1] > 2.0 * many.deviations[1]


def test_a_scan_after_one_of_the_ground_is_placed_by_those_before():
    noise, centres = np.random.default_rng(2), trees(2)
    recent, poses = RecentScans(), walk()
    for k in range(6):
        recent.remember(0.5 * k, points_at(poses[k], centres, noise), poses[k])
    ground = np.column_stack((np.full(120, 3.0), np.linspace(-5.0, 5.0, 120)))
    turned = poses[6] @ SE2(0.0, 0.0, 0.5)
    recent.remember(3.0, ground, turned)
    found = recent.place(3.5, points_at(poses[7], centres, noise), turned @ SE2(0.25, 0.0, 0.5))
    error = poses[7].to(found.motion)
    assert math.hypot(error.x, error.y) < 0.1
    assert abs(error.theta) < 0.02


def test_a_scan_that_is_placed_once_more_is_not_compared_with_itself():
    recent, points = RecentScans(), points_at(SE2.identity(), trees(3))
    recent.remember(0.0, points, SE2.identity())
    assert recent.place(0.0, points, SE2.identity()) is None
    recent.remember(0.0, points, SE2(1.0, 0.0, 0.0))
    assert recent.place(0.5, points, SE2(1.0, 0.0, 0.0)).motion == pytest.approx((1.0, 0.0, 0.0), abs=0.01)


@pytest.mark.parametrize("hits", [0, 20])
def test_scans_of_few_hits_place_nothing(hits):
    recent, points = RecentScans(), points_at(SE2.identity(), trees(3))
    recent.remember(0.0, points[:hits], SE2.identity())
    assert recent.place(0.5, points, SE2.identity()) is None
    recent.remember(1.0, points, SE2.identity())
    assert recent.place(1.5, points[:hits], SE2.identity()) is None


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_walk_among_trees_without_odometry_keeps_its_heading(seed):
    position, heading = errors(seed)
    assert position < 0.15
    assert heading < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "least"), [(0, 2.9), (1, 5.0), (2, 5.0)])
def test_a_walk_among_trees_is_lost_without_the_last_scans(seed, least, monkeypatch):
    """Ablation of `tbmslam.tracking.scan_to_scan`."""
    monkeypatch.setattr(RecentScans, "place", lambda *_: None)
    position, _ = errors(seed)
    assert position > least
