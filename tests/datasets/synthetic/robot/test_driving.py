import math
from itertools import pairwise

import numpy as np

from datasets.synthetic.robot.driving import drive_along


def line(*corners):
    points = [np.linspace(a, b, round(math.dist(a, b) / 0.1), endpoint=False) for a, b in pairwise(corners)]
    return np.vstack([*points, [corners[-1]]])


def test_a_straight_path_is_driven_straight_to_its_end():
    drive = drive_along(line((1, 1), (1, 9)), 0.5, np.random.default_rng(0), 100.0)
    np.testing.assert_allclose(drive.poses[:, 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(drive.poses[:, 2], math.pi / 2)
    assert abs(drive.poses[-1, 1] - 9.0) < 0.1
    assert drive.stamps[0] == 100.0


def test_a_robot_turns_back_where_the_path_does():
    drive = drive_along(line((0, 0), (4, 0), (0, 0)), 0.6, np.random.default_rng(1), 0.0)
    assert 3.5 < drive.poses[:, 0].max() < 4.2
    assert np.abs(drive.poses[:, 1]).max() < 0.25
    assert np.hypot(*drive.poses[-1, :2]) < 0.1


def test_a_corner_is_cut_by_little():
    path = line((0, 0), (5, 0), (5, 5))
    drive = drive_along(path, 0.7, np.random.default_rng(2), 0.0)
    off = np.hypot(*(drive.poses[:, None, :2] - path[None]).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.2


def test_length_and_duration_end_a_drive():
    path = line((0, 0), (50, 0))
    assert abs(drive_along(path, 0.6, np.random.default_rng(0), 0.0, length=7.0).length() - 7.0) < 0.02
    assert drive_along(path, 0.6, np.random.default_rng(0), 0.0, duration=12.0).stamps[-1] == 12.0
