import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.laser import SimulatedLaser
from merging.config.groups import JointConfig
from merging.joint_slam import Track, refine_jointly, rendered_alike
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2, compose, inverse
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive, DriveMotions
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import MapConfig
from tbmslam.map.tbm_map import TbmMap
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig
from tbmslam.sensing.laser_scan import LaserScan

# One worker makes the maps for all of them.
pytestmark = pytest.mark.xdist_group("joint slam")

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
    stops, xy = untold.hits.stops(CONFIG.stiffness_step_m), untold.sensors[:, :2]
    crossings = {
        (first, second)
        for number, first in enumerate(stops)
        for second in stops[number + 2 :]
        if np.hypot(*(xy[second] - xy[first])) < CONFIG.stiffness_reach_m
    }
    assert len(crossings) > 10
    assert {(edge.source, edge.target) for edge in edges[len(steps) :]} == crossings


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


LENGTH, STEP = 14.0, 0.25
T_WORLD_B = SE2(3.0, -2.0, 0.7)


def ways(world):
    """Two straight ways along the corridor of a building, a little apart, and there and back again."""
    start = world.places[np.argsort(world.places[:, 0])][len(world.places) // 2]
    along = np.arange(0.0, LENGTH, STEP)
    for offset in (0.0, 0.15):
        yield np.column_stack((start[0] - LENGTH / 2.0 + along, np.full(len(along), start[1] + offset), 0.0 * along))


def bent(way, bend):
    """The same way as a robot remembers it whose heading drifted."""
    steps = [SE2.from_array(a).inverse() @ SE2.from_array(b) for a, b in itertools.pairwise(way)]
    poses = [SE2.from_array(way[0])]
    for step in steps:
        poses.append(poses[-1] @ step @ SE2(0.0, 0.0, bend / len(steps)))
    return np.array(poses)


def map_of(world, way, remembered, T_map_world):
    laser = SimulatedLaser(
        beams=361, angle_min=-math.pi / 2, angle_increment=math.pi / 360, T_robot_sensor=SE2(0, 0, 0)
    )
    stamps = np.arange(len(way), dtype=np.float64)
    scans = laser.scans(world, stamps, way, np.random.default_rng(1))
    poses = [T_map_world @ SE2.from_array(pose) for pose in remembered]
    keyframes = Keyframes.from_scans(scans, poses, [SE2.identity()] * len(way))
    drive = Drive("robot", Trajectory(stamps, np.array(poses)), keyframes)
    return TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4)), (drive,))


@pytest.fixture(scope="module")
def bent_pair():
    world = make_world("corridor", 1)
    first, second = ways(world)
    maps = {
        "a": map_of(world, first, first, SE2.identity()),
        "b": map_of(world, second, bent(second, 0.06), T_WORLD_B.inverse()),
    }
    return maps, {"a": SE2.identity(), "b": T_WORLD_B}, second


def test_the_merged_frame_may_lie_far_away(bent_pair):
    maps, poses, _ = bent_pair
    shift = SE2(512_000.0, 4_600_000.0, 0.0)
    here = refine_jointly(maps, poses, JointConfig())
    there = refine_jointly(maps, {name: shift @ pose for name, pose in poses.items()}, JointConfig())
    for name in "ab":
        np.testing.assert_allclose(shift.inverse() @ there.poses[name], here.poses[name], atol=0.01)
        one, other = (np.array(found.maps[name].grid.geometry) for found in (here, there))
        np.testing.assert_allclose(other[1:3] - one[1:3], shift[:2], atol=0.06)


def test_a_distorted_drive_is_corrected_by_the_other_drive(bent_pair):
    maps, poses, truth = bent_pair
    before = poses["b"].apply(maps["b"].drives[0].keyframes.poses[:, :2])
    result = refine_jointly(maps, poses, JointConfig())
    assert result is not None
    first, second = (result.maps[name].drives[0].keyframes.poses for name in "ab")
    # Along a corridor hardly anything is determined; across it the drives must lie as they did, 15 cm apart.
    assert np.abs(before[:, 1] - truth[:, 1]).max() > 0.3
    assert np.abs(second[:, 1] - first[:, 1] - 0.15).max() < 0.05
    assert np.abs(second[:, 1] - truth[:, 1]).max() < 0.2  # the bend is shared by two drives equally stiff
    np.testing.assert_allclose(result.maps["b"].drives[0].trajectory.poses[:, :2], second[:, :2], atol=1e-6)
    assert result.closures >= JointConfig().min_closures
    assert result.links.ends.shape == (result.closures, 4)
    drives, seen = [result.maps[name].drives[0] for name in "ab"], []
    for one, here, other, there in result.links.ends:
        assert {one, other} == {0, 1}
        assert np.hypot(*((first, second)[one][here] - (first, second)[other][there])[:2]) < 6.0
        seen.append(drives[one].keyframes.sensor_pose(here).to(drives[other].keyframes.sensor_pose(there)))
    off = compose(inverse(result.links.motions.steps), np.array(seen))
    assert np.median(np.hypot(*off[:, :2].T)) < 0.1
    assert np.median(np.abs(off[:, 2])) < 0.01
    assert result.moved_m > 0.02
    assert result.maps["b"].grid.is_known().sum() > 1000


def test_trajectories_go_along_with_their_keyframes_where_stamps_step_back(bent_pair):
    maps, poses, _ = bent_pair
    back = np.repeat([0.0, 20.0, 20.5, 21.0], len(maps["b"].drives[0].trajectory) // 4)
    drive = maps["b"].drives[0]
    stamps = drive.trajectory.stamps - back
    again = replace(
        drive, trajectory=replace(drive.trajectory, stamps=stamps), keyframes=replace(drive.keyframes, stamps=stamps)
    )
    result = refine_jointly({**maps, "b": replace(maps["b"], drives=(again,))}, poses, JointConfig())
    assert result is not None
    moved = result.maps["b"].drives[0]
    np.testing.assert_array_equal(moved.trajectory.poses, moved.keyframes.poses)
    np.testing.assert_array_equal(moved.trajectory.stamps, stamps)


def test_what_a_robot_measured_outweighs_what_closing_loops_made_of_it(bent_pair):
    maps, poses, truth = bent_pair
    steps = [SE2.from_array(a).to(SE2.from_array(b)) for a, b in itertools.pairwise(truth)]
    known = DriveMotions(np.array(steps), np.tile(np.diag([0.004**-2, 0.004**-2, 0.001**-2]), (len(steps), 1, 1)))
    measured = {name: replace(one, drives=(replace(one.drives[0], motions=known),)) for name, one in maps.items()}
    config = JointConfig(adjustment=AdjustmentConfig(enabled=False))  # the walls alone tell nearly all of it
    told = refine_jointly(measured, poses, config)
    untold = refine_jointly(maps, poses, config)
    assert told is not None
    assert untold is not None
    off, off_untold = (
        np.abs(result.maps["b"].drives[0].keyframes.poses[:, 1] - truth[:, 1]).max() for result in (told, untold)
    )
    assert off < 0.1 < off_untold


def test_the_adjustment_to_walls_corrects_distortions_that_closures_leave(bent_pair):
    maps, poses, truth = bent_pair
    off = []
    for enabled in (False, True):
        result = refine_jointly(maps, poses, JointConfig(adjustment=AdjustmentConfig(enabled=enabled)))
        assert result is not None
        off.append(np.abs(result.maps["b"].drives[0].keyframes.poses[:, 1] - truth[:, 1]).max())
    assert off[1] < 0.5 * off[0]


def test_maps_without_keyframes_stay_rigid(bent_pair):
    maps, poses, _ = bent_pair
    bare = {"a": maps["a"], "b": TbmMap(maps["b"].grid)}
    assert refine_jointly(bare, poses, JointConfig()) is None


def test_drives_without_keyframes_stay_rigid(bent_pair):
    maps, poses, _ = bent_pair
    bare = replace(maps["b"].drives[0], keyframes=Keyframes.from_scans([], [], []))
    assert refine_jointly({"a": maps["a"], "b": replace(maps["b"], drives=(bare,))}, poses, JointConfig()) is None


@pytest.mark.parametrize("count", [1, 2])
def test_a_drive_of_two_keyframes_is_enough_and_of_one_is_not(bent_pair, count):
    """The short drive is one of two of its map; the other one finds the closures."""
    maps, poses, _ = bent_pair
    drive = maps["a"].drives[0]
    keyframes = drive.keyframes
    scans, poses_of_robot, mounts = (
        [each(k) for k in range(count)]
        for each in (keyframes.scan, keyframes.pose, lambda k: SE2.from_array(keyframes.sensor_poses[k]))
    )
    short = replace(
        drive, keyframes=Keyframes.from_scans(scans, poses_of_robot, mounts, keyframes.indices[:count].tolist())
    )
    both = {**maps, "a": replace(maps["a"], drives=(drive, short))}
    config = JointConfig(adjustment=AdjustmentConfig(enabled=False))
    assert (refine_jointly(both, poses, config) is not None) == (count == 2)


def test_drives_that_share_nothing_stay_rigid(bent_pair):
    maps, _, _ = bent_pair
    assert refine_jointly(maps, {"a": SE2.identity(), "b": SE2(500.0, 0.0, 0.0)}, JointConfig()) is None


@pytest.mark.parametrize("how_b", [MapConfig(), MapConfig(resolution=0.2)])
def test_the_parameters_of_a_map_without_a_limit_of_range_are_read_from_its_json(how_b):
    grid = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 4, 4))
    maps = [TbmMap(grid, (), {"config": {"map": json.loads(how.model_dump_json())}}) for how in (MapConfig(), how_b)]
    assert rendered_alike(maps) == (how_b == MapConfig())
