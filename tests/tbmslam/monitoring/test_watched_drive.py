"""What the whole of SLAM says of drives that go wrong: a knocked laser, a bare corridor."""

import math

import numpy as np
import pytest

from tbmslam.configuration.slam_config import KeyframeConfig, SlamConfig, preset
from tbmslam.geometry.se2 import SE2
from tbmslam.map.map_image import FREE_THRESHOLD
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.slam import Slam

BEAMS, FIRST = 361, -0.5 * math.pi
ANGLES = np.linspace(FIRST, -FIRST, BEAMS)
ROOMS = np.array([[-4, -4, 4, -4], [4, -4, 4, 4], [4, 4, -4, 4], [-4, 4, -4, -4], [1, -4, 1, -2], [-4, 2.5, -1.5, 3]])
CORRIDOR = np.array([[-500.0, -1.0, 500.0, -1.0], [500.0, 1.0, -500.0, 1.0]])


def ranges_from(pose, walls, generator):
    """Return how far walls (W, 4) are from a laser, up to 30 m."""
    ahead = np.column_stack((np.cos(ANGLES + pose.theta), np.sin(ANGLES + pose.theta)))
    begin, along = walls[:, :2] - (pose.x, pose.y), walls[:, 2:] - walls[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = ahead[:, None, 0] * along[None, :, 1] - ahead[:, None, 1] * along[None, :, 0]
        far = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0])[None] / across
        share = (begin[None, :, 0] * ahead[:, None, 1] - begin[None, :, 1] * ahead[:, None, 0]) / across
        there = np.where((far > 0.0) & (share >= 0.0) & (share <= 1.0), far, np.inf).min(axis=1)
    return np.where(there > 30.0, np.inf, there + generator.normal(0.0, 0.005, BEAMS))


def driven(poses, walls, generator, wheels=None, knocked_since=math.inf, slam=None):
    """Return SLAM after a drive along poses, ten a second, by a laser turned to the left from a reading on."""
    slam = slam or Slam()
    for k, pose in enumerate(poses):
        laser = pose @ SE2(0.0, 0.0, 0.3 if k >= knocked_since else 0.0)
        scan = LaserScan(0.1 * k, FIRST, math.pi / (BEAMS - 1), 0.05, 30.0, ranges_from(laser, walls, generator))
        slam.process(Reading(scan, T_odom_robot=None if wheels is None else wheels[k]))
    slam.finish()
    return slam


def told(slam):
    return [incident.text(0.0) for incident in slam.incidents]


@pytest.fixture
def winding():
    """A round along an eight through a room, some 25 m."""
    poses = []
    for t in 0.02 * np.arange(320):
        heading = math.atan2(3.0 * math.cos(2.0 * t), 2.5 * math.cos(t))
        poses.append(SE2(2.5 * math.sin(t), 1.5 * math.sin(2.0 * t), heading))
    return poses


def test_a_good_drive_causes_no_warning(winding, generator):
    assert told(driven(winding, ROOMS, generator, winding)) == []


def test_a_knocked_laser_causes_a_warning(winding, generator):
    (warning,) = [what for what in told(driven(winding, ROOMS, generator, winding, 160)) if "turned by" in what]
    assert warning.startswith("at 16.")
    assert "the laser turned by 17 degrees to the left" in warning


def test_a_bare_corridor_without_odometry_causes_a_warning(generator):
    poses = [SE2(0.06 * k, 0.0, 0.0) for k in range(200)]
    warnings = told(driven(poses, CORRIDOR, generator))
    assert [what for what in warnings if "neither odometry nor scans determine the motion" in what]
    assert not [what for what in told(driven(poses, CORRIDOR, generator, poses)) if "neither" in what]


def test_a_robot_at_rest_is_told_how_each_of_its_scans_is_drawn(generator):
    rest = [SE2(0.0, 0.0, 0.0)] * 60
    once = driven(rest, ROOMS, generator)
    assert [what for what in told(once) if "the map is drawn from 1 of 60 scans" in what]
    every = driven(rest, ROOMS, generator, slam=Slam(SlamConfig(keyframes=KeyframeConfig(distance=0.0))))
    assert told(every) == [what for what in told(once) if "hardly moved" not in what]
    free = [slam.finish().grid.pignistic() < FREE_THRESHOLD for slam in (once, every)]
    assert free[0].sum() < 0.2 * free[1].sum()
    assert not [what for what in told(driven(rest, ROOMS, generator, slam=Slam(preset("viny-hc")))) if "hardly" in what]
