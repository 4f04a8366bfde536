import math

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.laser import SimulatedLaser
from merging.config import MergeConfig
from merging.fusion.fusion import fuse
from merging.fusion.warping import warp
from merging.joint_slam.rendering import redraw
from merging.map_graph.grouping import Group
from merging.merged_group import merge_group
from tbmslam.belief.grid_resampling import resample
from tbmslam.evaluation.map_agreement import cell_labels, map_agreement
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.config import MapConfig
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import render
from tbmslam.map.tbm_map import Drive, TbmMap
from tbmslam.parallel.progress import Watch

POSES = {"a": SE2.identity(), "b": SE2(3.0, -2.0, 0.7)}


def seen_along(world, way, T_map_world, seed, how):
    laser = SimulatedLaser(
        beams=361, angle_min=-math.pi / 2, angle_increment=math.pi / 360, T_robot_sensor=SE2(0, 0, 0)
    )
    stamps = np.arange(len(way), dtype=np.float64)
    scans = laser.scans(world, stamps, way, np.random.default_rng(seed))
    poses = [T_map_world @ SE2.from_array(pose) for pose in way]
    keyframes = Keyframes.from_scans(scans, poses, [SE2.identity()] * len(way))
    drive = Drive("robot", Trajectory(stamps, np.array(poses)), keyframes)
    return TbmMap(render([keyframes], how), (drive,), {"config": {"map": how.model_dump(mode="json")}})


def robots(how_b=None):
    """Two robots that drive through one building's corridor."""
    world, how = make_world("office", 1), MapConfig()
    start = world.places[np.argsort(world.places[:, 0])][len(world.places) // 2]
    along = np.arange(0.0, 8.0, 0.25)
    way = np.column_stack((start[0] - 4.0 + along, np.full(len(along), start[1]), 0.0 * along))
    return {
        "a": seen_along(world, way, SE2.identity(), 1, how),
        "b": seen_along(world, way + np.array([0.0, 0.1, 0.0]), POSES["b"].inverse(), 2, how_b or how),
    }


@pytest.fixture(scope="module")
def maps():
    return robots()


def merged(maps, **settings):
    return merge_group(maps, Group(POSES), MergeConfig(**settings), Watch())


def fused(one, maps, *how):
    assert one.joint is not None
    layers = [warp(joined.grid, SE2.identity(), maps["a"].grid.geometry) for joined in one.joint.maps.values()]
    return fuse(layers, *how)


def test_drives_straightened_together_are_drawn_into_one_grid_from_all_scans(maps):
    one = merged(maps)
    assert one.joint is not None
    keyframes = [drive.keyframes for joined in one.joint.maps.values() for drive in joined.drives]
    geometry = one.fusion.grid.geometry
    np.testing.assert_array_equal(
        one.fusion.grid.masses, resample(redraw(keyframes, maps["a"]), SE2.identity(), geometry).masses
    )
    assert one.merged.grid is one.fusion.grid
    assert one.fusion.rule == "redrawn"
    # What the robots' own maps say of each other stays to be told.
    by_rule = fused(one, maps, "disjunctive")
    np.testing.assert_array_equal(one.fusion.conflict, by_rule.conflict)
    np.testing.assert_array_equal(one.fusion.seen_by, by_rule.seen_by)
    # Disjunction makes ignorance of what one scan more would decide.
    true = cell_labels(resample(render(keyframes, MapConfig()), SE2.identity(), geometry))
    assert map_agreement(cell_labels(one.fusion.grid), true).agree == 1.0
    assert map_agreement(cell_labels(by_rule.grid), true).agree < 1.0


@pytest.mark.parametrize("rule", ["disjunctive", "dempster"])
def test_a_rule_that_is_asked_for_is_followed(maps, rule):
    one = merged(maps, rule=rule)
    np.testing.assert_array_equal(one.fusion.grid.masses, fused(one, maps, rule).grid.masses)
    assert one.fusion.rule == rule


def test_what_only_a_rule_can_do_is_done_by_the_disjunctive_one(maps):
    one = merged(maps, coverage="overlap")
    np.testing.assert_array_equal(one.fusion.grid.masses, fused(one, maps, "disjunctive", "overlap").grid.masses)
    doubted = merged(maps, reliability={"b": 0.5})
    by_rule = fused(doubted, maps, "disjunctive", "union", [1.0, 0.5])
    np.testing.assert_array_equal(doubted.fusion.grid.masses, by_rule.grid.masses)


def test_maps_drawn_in_two_ways_are_fused():
    maps = robots(MapConfig(resolution=0.1))
    one = merged(maps)
    np.testing.assert_array_equal(one.fusion.grid.masses, fused(one, maps, "disjunctive").grid.masses)


def test_rigid_maps_are_fused(maps):
    one = merged(maps, joint={"enabled": False})
    layers = [warp(maps[name].grid, POSES[name], maps["a"].grid.geometry) for name in maps]
    np.testing.assert_array_equal(one.fusion.grid.masses, fuse(layers, "disjunctive").grid.masses)
    assert one.fusion.rule == "disjunctive"
