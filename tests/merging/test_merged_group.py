import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.laser import SimulatedLaser
from merging.config import MergeConfig
from merging.fusion import CellSizeError, fuse, warp
from merging.joint_slam import redraw
from merging.map_graph.grouping import Group
from merging.merged_group import group_maps_of, jointly_refined, merge_group, most_known_first
from merging.verification import examine
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.evaluation.map_agreement import cell_labels, map_agreement
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.edits import without_scans
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import MapConfig, render
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Progress

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
    return merge_group(maps, Group(POSES), MergeConfig(**settings), Progress())


def fused(one, maps, *how):
    assert one.joint is not None
    layers = [warp(joined.grid, SE2.identity(), maps["a"].grid.geometry) for joined in one.joint.maps.values()]
    return fuse(layers, *how)


def test_the_loops_between_drives_are_kept_through_a_second_merge(maps):
    pair = merged(maps)
    links = pair.merged.links
    assert links is not None
    np.testing.assert_array_equal(links.ends, pair.joint.links.ends)
    unplaced = replace(maps["a"], drives=(replace(maps["a"].drives[0], name="alone"),))
    again = merge_group(
        {"alone": unplaced, "pair": pair.merged},
        Group({"alone": SE2.identity(), "pair": SE2.identity()}),
        MergeConfig(joint={"enabled": False}),
        Progress(),
    )
    assert [drive.name for drive in again.merged.drives] == ["alone", "a/robot", "b/robot"]
    np.testing.assert_array_equal(again.merged.links.ends, links.ends + np.array([1, 0, 1, 0]))
    np.testing.assert_array_equal(again.merged.links.motions.steps, links.motions.steps)
    assert again.merged.moved(SE2(1.0, 0.0, 0.0), again.merged.grid).links is again.merged.links
    assert without_scans(pair.merged).links is None
    assert merged(maps, joint={"enabled": False}).merged.links is None


def test_jointly_optimised_drives_are_rendered_into_one_grid(maps):
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


WALL, FREE = (0.0, 0.1, 0.8, 0.1), (0.0, 0.9, 0.0, 0.1)


def room(wall_row):
    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 20, 20))
    grid.masses[5:15, 5:15] = FREE
    grid.masses[wall_row, 5:15] = WALL
    return TbmMap(grid)


MAPS = {"a": room(5), "b": room(14), "c": room(9)}
ORDERS = ("a", "bare"), ("bare", "a")
GROUP_POSES = {"a": SE2(7.0, 0.0, 0.0), "b": SE2(7.0, 1.0, 0.0)}


def group_map(poses, maps=MAPS, config=None):
    (whole,) = group_maps_of(maps, [poses], config or MergeConfig(), Progress())
    return whole


def test_a_group_map_lies_in_the_frame_of_one_of_its_maps():
    whole = group_map(GROUP_POSES)
    assert whole.T_common_map == GROUP_POSES["a"]
    walls = np.argwhere(whole.grid.masses[..., 2] > 0.7)
    ys = {round(whole.grid.geometry.centre_of(float(row), float(col))[1], 2) for row, col in walls}
    assert ys == {0.55, 2.45}


def test_a_joint_optimisation_removes_differences_of_groups(maps):
    shifted = [{"a": POSES["a"]}, {"b": SE2(0.15, 0.1, 0.0) @ POSES["b"]}]
    joint = jointly_refined(maps, shifted[0] | shifted[1], MergeConfig(), Progress())
    assert joint is not None
    shares = []
    for refinement in (None, joint):
        groups = group_maps_of(maps, shifted, MergeConfig(), Progress(), refinement)
        walls = [WallMap.from_grid(group.grid, MergeConfig().structure) for group in groups]
        motion = groups[0].T_common_map.inverse() @ groups[1].T_common_map
        shares.append(examine(*walls, motion, MergeConfig().verification).agreement)
    assert shares[0] < 0.8
    assert shares[1] > 0.95


def test_a_map_without_drives_keeps_its_pose_in_a_joint_optimisation(maps):
    plan = TbmMap(maps["b"].grid)
    poses = {**POSES, "plan": POSES["b"]}
    joint = jointly_refined({**maps, "plan": plan}, poses, MergeConfig(), Progress())
    assert joint is not None
    assert joint.maps.keys() == {"a", "b"}
    whole, alone = group_maps_of(
        {**maps, "plan": plan}, [poses, {"plan": POSES["b"]}], MergeConfig(), Progress(), joint
    )
    assert (alone.grid, alone.T_common_map) == (plan.grid, POSES["b"])
    there = warp(plan.grid, whole.T_common_map.inverse() @ POSES["b"], whole.grid.geometry)
    agreement = map_agreement(cell_labels(whole.grid), cell_labels(there))
    assert agreement.agree > 0.97


def test_a_group_is_optimised_on_its_own_without_a_joint_optimisation_of_all(maps):
    together = group_maps_of(
        maps, [POSES], MergeConfig(), Progress(), jointly_refined(maps, POSES, MergeConfig(), Progress())
    )
    alone = group_maps_of(maps, [POSES], MergeConfig(), Progress())
    np.testing.assert_array_equal(together[0].grid.masses, alone[0].grid.masses)
    assert jointly_refined(maps, {"a": POSES["a"]}, MergeConfig(), Progress()) is None


def test_a_group_of_one_map_without_drives_keeps_its_grid():
    whole = group_map({"c": SE2(3.0, 4.0, 1.0)})
    assert whole.grid is MAPS["c"].grid
    assert whole.T_common_map == SE2(3.0, 4.0, 1.0)


def test_a_group_map_has_the_frame_of_its_largest_map_in_any_order():
    bare = room(9)
    bare.grid.masses[5:8] = (0.0, 0.0, 0.0, 1.0)
    maps, poses = {"bare": bare, "a": MAPS["a"]}, {"bare": SE2(7.0, 1.0, 0.0), "a": SE2(7.0, 0.0, 0.0)}
    wholes = [group_map({name: poses[name] for name in names}, maps) for names in ORDERS]
    assert wholes[0].T_common_map == wholes[1].T_common_map == poses["a"]
    np.testing.assert_array_equal(wholes[0].grid.masses, wholes[1].grid.masses)


@pytest.mark.parametrize(
    "wanted",
    [{"rule": "conjunctive"}, {"coverage": "overlap"}, {"reliability": {"a": 0.1}}, {"merged_resolution": 0.2}],
)
def test_what_the_merged_map_shall_hold_does_not_change_what_the_maps_know(wanted):
    asked, plain = (group_map(GROUP_POSES, config=MergeConfig.model_validate(each)) for each in (wanted, {}))
    assert asked.grid.geometry == plain.grid.geometry
    np.testing.assert_array_equal(asked.grid.masses, plain.grid.masses)


def test_a_group_of_too_many_cells_is_not_merged():
    far, near = {"a": SE2.identity(), "b": SE2(3000.0, 3000.0, 0.0)}, {"c": SE2.identity()}
    with pytest.raises(CellSizeError, match=r"3001 x 3001 m in cells of 0\.1 m would be"):
        group_maps_of(MAPS, [far, near], MergeConfig(merged_resolution=1.0), Progress())
    fine = MergeConfig(resolution=0.01)  # the groups would be compared in these cells
    with pytest.raises(CellSizeError):
        group_maps_of(MAPS, [{**far, "b": SE2(500.0, 500.0, 0.0)}, near], fine, Progress())


def test_the_largest_map_is_chosen_by_area_and_not_by_cells():
    """150 cells of 5 cm are less than 100 of 10 cm, and 600 are more."""

    def knowing(resolution, cells):
        grid = TbmGrid.unknown(GridGeometry(resolution, 0.0, 0.0, 30, 30))
        grid.masses.reshape(-1, 4)[:cells] = (0.0, 1.0, 0.0, 0.0)
        return TbmMap(grid)

    maps = {"few": knowing(0.05, 150), "coarse": knowing(0.1, 100), "many": knowing(0.05, 600)}
    assert most_known_first(maps, maps) == ["many", "coarse", "few"]
    assert most_known_first(maps, reversed(maps)) == ["many", "coarse", "few"]
