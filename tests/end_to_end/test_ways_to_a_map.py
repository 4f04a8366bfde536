"""Every way from recordings to a merged map that the programs offer, on a small simulated flat."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from datasets.synthetic.bag_writing import write_ros1_bag
from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import OdometryNoise
from datasets.synthetic.robot.simulation import simulate as simulate_robots
from datasets.synthetic.world.world import load_world
from tbmslam.belief.grid_resampling import resample
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map
from tests.belief_rules import disjunctive
from tests.end_to_end import programs
from tests.end_to_end.against_truth import alignment_errors, placed, share_of_cells_as_in
from tests.end_to_end.programs import build, contents, merge_maps, simulate

pytestmark = pytest.mark.xdist_group("flat")

SMALL = ("--world", "apartment", "--seed", 3, "--beams", 361, "--rate", 8, "--length", 45)


def true_poses(bags, maps, names):
    return {name: placed(bags, maps, name).T_reference_estimate for name in names}


def test_a_bag_for_each_robot(flat, flat_maps, flat_merged):
    names = ("robot_0", "robot_1")
    report = programs.report(flat_merged)
    for metres, degrees in alignment_errors(report, true_poses(flat, flat_maps, names), names).values():
        assert metres < 0.10
        assert degrees < 0.5


def test_one_bag_split_for_two_robots(tmp_path):
    bag = simulate(tmp_path / "long", *SMALL[:-1], 80) / "robot_0.bag"
    reference = tmp_path / "long" / "robot_0.truth.tum"
    split = ("--robots", 2, "--overlap", 0.5, "--reference", reference)
    maps = build(tmp_path / "maps", bag, *split)
    report = merge_maps(tmp_path / "merged", maps / "robot_0_0", maps / "robot_0_1")
    truth = json.loads((maps / "truth.json").read_text())["robots"]
    assert {entry["reference"] for entry in truth.values()} == {"robot_0.truth.tum"}
    T_reference_map = {name: SE2(*entry["T_reference_map"]) for name, entry in truth.items()}
    ((metres, degrees),) = alignment_errors(report, T_reference_map, ["robot_0_1"]).values()
    assert metres < 0.10
    assert degrees < 0.5
    segments = [json.loads((maps / name / "run.json").read_text())["segment"] for name in ("robot_0_0", "robot_0_1")]
    assert segments[0]["start"] == 0
    assert segments[0]["start"] < segments[1]["start"] < segments[0]["stop"] < segments[1]["stop"]


@pytest.fixture(scope="module")
def split_drive(flat, tmp_path_factory):
    """What is written for the halves of a drive whose truth is given."""
    truth = ("--reference", flat / "robot_0.truth.tum")
    return contents(build(tmp_path_factory.mktemp("split"), flat / "robot_0.bag", "--robots", 2, *truth))


def test_the_files_of_a_robot_do_not_contain_the_truth(flat, split_drive, tmp_path):
    """The maps of two runs differ in nothing whether or not a truth was given."""
    untold = build(tmp_path / "untold", flat / "robot_0.bag", "--robots", 2, "--no-truth")
    assert not (untold / "truth.json").exists()
    assert {name: data for name, data in split_drive.items() if name != "truth.json"} == contents(untold)


def test_building_twice_gives_the_same_bytes(flat, split_drive, tmp_path):
    truth = ("--reference", flat / "robot_0.truth.tum")
    first, second = split_drive, contents(build(tmp_path / "second", flat / "robot_0.bag", "--robots", 2, *truth))
    assert first == second
    assert {"truth.json", "robot_0_0/map.npz", "robot_0_1/run.json", "robot_0_1/trajectory.tum"} <= first.keys()


def test_an_mcap_bag_gives_the_map_of_the_ros_1_bag(flat, tmp_path):
    mcap = simulate(tmp_path / "mcap", *SMALL, "--robots", 2, "--overlap", 0.6, "--format", "mcap")
    maps = build(
        tmp_path / "maps", flat / "robot_0.bag", mcap / "robot_0", "--separate", "--no-truth", "--frames", "odometry"
    )
    names = f"{flat.name}_robot_0", "mcap_robot_0"
    ros1, ros2 = (load_map(maps / name) for name in names)
    assert ros1.grid.geometry == ros2.grid.geometry
    np.testing.assert_allclose(ros1.grid.masses, ros2.grid.masses, atol=1e-6)
    file = next((mcap / "robot_0").glob("*.mcap"))
    alone = build(tmp_path / "file", file, "--frames", "odometry")
    assert (alone / "robot_0" / "trajectory.tum").read_bytes() == (maps / names[1] / "trajectory.tum").read_bytes()


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_laser_upside_down_behind_and_turned(tmp_path, kind):
    mount = ("--mount", -0.2, 0.15, 130, "--upside-down", "--format", kind)
    bags = simulate(tmp_path / "bags", *SMALL, *mount, "--no-return", "inf")
    maps = build(tmp_path / "maps", bags / ("robot_0.bag" if kind == "ros1" else "robot_0"))
    laid = placed(bags, maps, "robot_0")
    assert laid.ate_m < 0.05
    grid = load_map(maps / "robot_0").grid
    assert share_of_cells_as_in(load_world(bags), grid, laid.T_reference_estimate) > 0.97
    recording = json.loads((maps / "robot_0" / "run.json").read_text())["recording"]
    assert recording["upside_down"] is True
    assert recording["T_robot_sensor"] == pytest.approx([-0.2, 0.15, math.radians(130)])


def test_several_bags_are_one_recording(tmp_path):
    """A drive recorded in two files gives the map of the same drive in one."""
    world = make_world("apartment", 3)
    first, step = SimulatedLaser.field_of(361)
    laser = SimulatedLaser(beams=361, angle_min=first, angle_increment=step, rate=8.0)
    (robot,) = simulate_robots(world, plan_drives(world, 1, length=30.0), laser, OdometryNoise.preset("good"))
    middle = robot.readings[len(robot.readings) // 2].scan.stamp
    for name, begin, end in (("whole", -math.inf, math.inf), ("part1", -math.inf, middle), ("part2", middle, math.inf)):
        inside = (robot.odometry.stamps >= begin - 0.1) & (robot.odometry.stamps < end + 0.1)
        kept = [number for number, reading in enumerate(robot.readings) if begin <= reading.scan.stamp < end]
        part = replace(
            robot,
            readings=tuple(robot.readings[number] for number in kept),
            recorded=robot.recorded[kept],
            odometry=Trajectory(robot.odometry.stamps[inside], robot.odometry.poses[inside]),
        )
        write_ros1_bag(part, tmp_path / f"{name}.bag")
    build(tmp_path / "whole", tmp_path / "whole.bag")
    build(tmp_path / "parts", tmp_path / "part2.bag", tmp_path / "part1.bag")
    whole, parts = tmp_path / "whole" / "whole", tmp_path / "parts" / "part1"  # named after the first by name
    assert (parts / "trajectory.tum").read_bytes() == (whole / "trajectory.tum").read_bytes()
    counts = json.loads((parts / "run.json").read_text())
    assert counts["result"]["scans"] == len(robot.readings)


@pytest.mark.parametrize("preset", ["viny", pytest.param("viny-hc", marks=pytest.mark.slow)])
def test_the_original_s_method_from_bag_to_merged_map(flat, tmp_path, preset):
    maps = build(
        tmp_path / "maps", flat / "robot_0.bag", flat / "robot_1.bag", "--separate", "--no-truth", "--preset", preset
    )
    names = ("robot_0", "robot_1")
    for name in names:
        assert placed(flat, maps, name).ate_m < 0.5
        assert load_map(maps / name).grid.geometry.resolution == 0.1
    report = merge_maps(tmp_path / "merged", maps / "robot_0", maps / "robot_1")
    ((metres, degrees),) = alignment_errors(report, true_poses(flat, maps, names), ["robot_1"]).values()
    assert metres < 0.5
    assert degrees < 2.0


def test_the_paper_s_chain_from_bag_to_merged_map(flat, tmp_path):
    maps = build(tmp_path / "maps", flat, "--separate", "--no-truth", "--preset", "paper")
    names = ("robot_0", "robot_1")
    report = merge_maps(tmp_path / "merged", maps, "--preset", "paper")
    assert report["fusion"]["rule"] == "disjunctive"
    assert report["refinement"] == {"kind": "rigid", "bent": []}
    assert report["pairs"][0]["method"] == "dobrokhvalov-filatov"
    ((metres, degrees),) = alignment_errors(report, true_poses(flat, maps, names), ["robot_1"]).values()
    assert metres < 0.5
    assert degrees < 2.0
    # The keypoints' motion as it is, and eq. 6 in every cell that both maps know; all others are unknown.
    merged, (first, second) = load_map(tmp_path / "merged").grid, (load_map(maps / name).grid for name in names)
    T_merged_map = SE2(*report["maps"]["robot_1"]["T_merged_map"])
    assert T_merged_map == pytest.approx(SE2(*report["pairs"][0]["T_target_source"]))
    layers = [resample(first, SE2.identity(), merged.geometry), resample(second, T_merged_map, merged.geometry)]
    both = layers[0].is_known() & layers[1].is_known()
    np.testing.assert_array_equal(merged.is_known(), both)
    np.testing.assert_allclose(
        merged.masses[both], disjunctive(layers[0].masses[both], layers[1].masses[both]), atol=1e-5
    )


@pytest.mark.parametrize("arguments", [("--rule", "conjunctive"), ("--coverage", "overlap"), ("--resolution", 0.1)])
def test_ways_to_fuse(flat_maps, tmp_path, arguments):
    report = merge_maps(tmp_path / "merged", flat_maps / "robot_0", flat_maps / "robot_1", *arguments)
    merged = load_map(tmp_path / "merged").grid
    masses = merged.masses
    np.testing.assert_allclose(masses.sum(axis=-1), 1.0, atol=1e-5)
    if arguments[0] == "--rule":
        assert report["fusion"]["conflict_m2"] > 0.0
        assert masses[..., 0].max() > 0.5
    elif arguments[0] == "--coverage":
        assert report["fusion"]["known_m2"] <= report["fusion"]["seen_by_several_m2"] + 1e-6
    else:
        assert merged.geometry.resolution == 0.1
