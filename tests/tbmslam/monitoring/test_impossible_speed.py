"""Drives that no robot drives."""

import numpy as np
import pytest

from tbmslam.monitoring.impossible_speed import impossible_speed

STAMPS = 50.0 + 0.1 * np.arange(1000)
NONE = np.full((100, 3), np.nan)


def straight(speeds):
    poses = np.zeros((len(STAMPS), 3))
    poses[:, 0] = np.cumsum(0.1 * speeds)
    return poses


def test_a_drive_of_a_robot():
    assert impossible_speed(STAMPS, straight(np.full(1000, 1.5)), STAMPS[::10], NONE) is None


def test_one_of_no_robot_is_told_with_its_time():
    speeds = np.where((np.arange(1000) >= 400) & (np.arange(1000) < 600), 7.0, 1.0)
    found = impossible_speed(STAMPS, straight(speeds), STAMPS[::10], NONE)
    assert found is not None
    assert found.speed == pytest.approx(7.0, abs=0.1)
    assert 90.0 <= found.stamp <= 100.0
    assert "at 7.0 m/s for 10 s" in found.warning()


def test_odometry_that_says_so_too_is_believed():
    poses = straight(np.full(1000, 6.0))
    assert impossible_speed(STAMPS, poses, STAMPS[::10], poses[::10]) is None
    assert impossible_speed(STAMPS, poses, STAMPS[::10], 0.1 * poses[::10]) is not None


def test_noise_and_a_clock_that_steps_back_are_no_speed(generator):
    poses = straight(np.full(1000, 1.0))
    poses[:, 1] += generator.normal(0.0, 0.3, 1000)  # 6 m/s from scan to scan
    back = STAMPS - 30.0 * (np.arange(1000) >= 500)
    for stamps in (STAMPS, back):
        assert impossible_speed(stamps, poses, stamps[::10], NONE) is None


def test_a_few_seconds_tell_nothing():
    poses = straight(np.full(1000, 9.0))
    assert impossible_speed(STAMPS[:50], poses[:50], STAMPS[:50:10], NONE[:5]) is None
    assert impossible_speed(STAMPS[:1], poses[:1], STAMPS[:1], NONE[:1]) is None
