import numpy as np
import pytest

from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, adjust
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose
from tbmslam.sensing.laser_scan import LaserScan
from tests.tbmslam.drifting_drive import drifting_keyframes, errors, packed

CONFIG = AdjustmentConfig()
INFORMATION = np.diag([0.004**-2, 0.004**-2, 0.002**-2])


def chain_of(poses, information=INFORMATION):
    edges = [MotionEdge(k, k + 1, relative_pose(poses, k, k + 1), information) for k in range(len(poses) - 1)]
    return MotionChain.of(edges)


@pytest.mark.parametrize("world", ["office", "store", "corridor"])
def test_a_drive_that_bent_is_straightened_by_its_walls_alone(drive_in, world):
    true, tracked, scans = drifting_keyframes(drive_in(world, 40.0, seed=1), 0.0003, 0.3)
    adjusted = adjust(tracked, [scans], [chain_of(tracked)], [], 2.0, CONFIG)
    np.testing.assert_allclose(adjusted[0], tracked[0], atol=0.01)
    assert errors(true, tracked).max() > 0.05
    assert errors(true, adjusted).max() < 0.5 * errors(true, tracked).max()


def test_a_heading_means_the_same_after_whole_turns(drive_in):
    _, tracked, scans = drifting_keyframes(drive_in("office", 40.0, seed=1), 0.001, 0.3)
    turned = tracked + np.column_stack((np.zeros((len(tracked), 2)), -2.0 * np.pi * (np.arange(len(tracked)) % 3)))
    first, second = (adjust(poses, [scans], [chain_of(tracked)], [], 2.0, CONFIG) for poses in (tracked, turned))
    assert errors(first, second).max() < 1e-6


def test_an_exact_drive_stays(drive_in):
    true, _, scans = drifting_keyframes(drive_in("office", 40.0, seed=1), 0.0, 0.3)
    assert errors(true, adjust(true, [scans], [chain_of(true)], [], 2.0, CONFIG)).max() < 0.02


def test_two_drives_through_one_building_are_laid_onto_each_other(drive_in):
    true, _, scans = drifting_keyframes(drive_in("office", 40.0, seed=1), 0.0, 0.3)
    beside = true.copy()
    beside[:, :2] += 0.05, -0.04  # the second drive's map is off
    adjusted = adjust(np.vstack((true, beside)), [scans, scans], [chain_of(true), chain_of(beside)], [], 2.0, CONFIG)
    apart = errors(adjusted[: len(true)], adjusted[len(true) :])
    assert apart.max() < 0.01


def test_where_nothing_was_hit_the_motions_decide():
    poses = np.column_stack((np.arange(20) * 0.4, np.zeros(20), np.zeros(20)))
    bent = poses + np.column_stack((np.zeros(20), 0.002 * np.arange(20) ** 2, np.zeros(20)))
    scans = packed([LaserScan(0.1 * k, -1.0, 0.02, 0.1, 30.0, np.full(100, np.inf)) for k in range(20)])
    adjusted = adjust(bent, [scans], [chain_of(poses)], [], 2.0, CONFIG)
    straight = np.array([relative_pose(adjusted, k, k + 1) for k in range(19)])
    assert np.abs(straight[:, 2]).max() < 0.01
    assert errors(poses, adjusted).max() < 0.5 * errors(poses, bent).max()


def test_closures_keep_their_say_where_walls_leave_a_direction_open():
    # Between two bare walls nothing but the closure knows how far the robot came.
    true = np.column_stack((np.r_[np.arange(20), 19 - np.arange(20)] * 0.4, np.zeros(40), np.zeros(40)))
    angles = -1.5 + 0.02 * np.arange(151)
    ranges = np.minimum(1.5 / np.maximum(np.abs(np.sin(angles)), 0.05), 29.0)
    scans = packed([LaserScan(0.1 * k, -1.5, 0.02, 0.1, 30.0, ranges) for k in range(40)])
    short = true * [0.97, 1.0, 1.0]
    short[20:, 0] = short[19, 0] - (true[19, 0] - true[20:, 0]) * 1.0
    believed = chain_of(short, np.diag([1e3, 1e5, 1e6]))
    closure = MotionEdge(0, 39, relative_pose(true, 0, 39), np.diag([1e6, 1e6, 1e6]))
    without, closed = (adjust(short, [scans], [believed], edges, 2.0, CONFIG) for edges in ([], [closure]))
    assert abs(without[39, 0] - without[0, 0]) > 0.15
    assert abs(closed[39, 0] - closed[0, 0]) < 0.05


@pytest.mark.parametrize("count", [1, 2])
def test_a_drive_too_short_to_bend_stays(count):
    poses = np.column_stack((np.arange(count) * 0.1, np.zeros(count), np.zeros(count)))
    scans = packed([LaserScan(0.1 * k, -1.0, 0.02, 0.1, 30.0, np.full(100, 3.0)) for k in range(count)])
    np.testing.assert_allclose(adjust(poses, [scans], [chain_of(poses)], [], 2.0, CONFIG), poses, atol=1e-6)


def test_the_same_drive_gives_the_same_poses(drive_in):
    _, tracked, scans = drifting_keyframes(drive_in("office", 40.0, seed=1), 0.001, 0.3)
    first, second = (adjust(tracked, [scans], [chain_of(tracked)], [], 2.0, CONFIG) for _ in range(2))
    np.testing.assert_array_equal(first, second)
