"""Odometry that begins anew in a pause, while the robot stands."""

from dataclasses import replace

import numpy as np
import pytest

from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.monitoring.odometry_check import BEGAN_ANEW
from tbmslam.sensing.segmentation import in_frame
from tbmslam.tracking.constant_velocity import ConstantVelocity
from tests.tbmslam.monitoring.monitored import mapped, said


def after_a_pause(readings):
    """Return readings ten minutes later."""
    return [replace(r, scan=replace(r.scan, stamp=r.scan.stamp + 600.0)) for r in readings]


def restarted(drive_in, share, seed):
    """Return an office drive whose odometry begins anew in a pause after some of it, as it is mapped, and its error."""
    robot = drive_in("office", 40.0, odometry="good", seed=seed)
    half = round(share * len(robot.readings))
    before, after = robot.readings[:half], after_a_pause(robot.readings[half:])
    T_new_odom = after[0].T_odom_robot.inverse()
    anew = [replace(in_frame(r, T_new_odom), T_odom_origin=SE2.identity()) for r in after]
    slam, drive = mapped([*before, *anew])
    trajectory = Trajectory(robot.truth.stamps, drive.trajectory.poses)
    return slam, align_trajectories(robot.truth, trajectory).ate_m


@pytest.mark.parametrize("share", [0.4, 0.7])
def test_odometry_that_begins_anew_in_a_pause_does_not_move_the_robot(drive_in, share):
    slam, error_m = restarted(drive_in, share, 3)
    assert error_m < 0.005
    (line,) = said(slam)
    assert BEGAN_ANEW in line


def test_a_robot_that_returned_to_its_start_in_a_pause_is_there(drive_in):
    """Its odometry is at its origin too."""
    robot = drive_in("office", 40.0, odometry="good", seed=3)
    half, again = len(robot.readings) // 2, 60
    _, drive = mapped([*robot.readings[:half], *after_a_pause(robot.readings[:again])])
    found = drive.trajectory.poses
    assert np.hypot(*(found[half:] - found[:again])[:, :2].T).max() < 0.02
    assert np.hypot(*(found[half - 1] - found[half])[:2]) > 3.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_odometry_that_begins_anew_in_a_pause_needs_that_hypothesis(drive_in, monkeypatch, seed):
    """Ablation of `PosePrior.stood`."""
    shares = 0.4, 0.7
    assert max(restarted(drive_in, share, seed)[1] for share in shares) < 0.005
    monkeypatch.setattr(ConstantVelocity, "standing", lambda *_: None)
    assert max(restarted(drive_in, share, seed)[1] for share in shares) > 1.0
