"""Three robots with MIT Stata Center's laser in an office: from their bags to one map, held against the building."""

import pytest

from datasets.synthetic.world.world import load_world
from tbmslam.evaluation.map_agreement import cell_labels, map_agreement
from tbmslam.io.map_folder import load_map
from tests.end_to_end.against_truth import alignment_errors, placed, share_of_cells_as_in
from tests.end_to_end.programs import merge_maps, report, simulate
from tools import build_maps

ROBOTS = ("robot_0", "robot_1", "robot_2")

# One worker simulates the office for all of them.
pytestmark = pytest.mark.xdist_group("office")


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_trajectory_of_each_robot_is_accurate(office, robot):
    laid = placed(office / "bags", office / "maps", robot)
    assert laid.ate_m <= 0.05
    assert laid.errors_m.max() <= 0.25
    # A pose for every scan, not only for keyframes.
    assert len(laid.errors_m) == len((office / "bags" / f"{robot}.truth.tum").read_text().splitlines())


def test_the_maps_lie_where_they_belong(office):
    T_world_map = {robot: placed(office / "bags", office / "maps", robot).T_reference_estimate for robot in ROBOTS}
    for metres, degrees in alignment_errors(report(office / "merged"), T_world_map, ROBOTS).values():
        assert metres <= 0.10
        assert degrees <= 0.5


def test_each_robot_s_frame_is_its_own(office):
    """Nothing downstream can lean on a common frame: the maps are turned and shifted against each other."""
    poses = [report(office / "merged")["maps"][robot]["T_merged_map"] for robot in ROBOTS[1:]]
    for x, y, theta in poses:
        assert abs(x) + abs(y) > 1.0
        assert abs(theta) > 0.1


@pytest.mark.parametrize("robot", [None, *ROBOTS])
def test_cells_are_as_in_the_building(office, robot):
    folder = office / "maps" / robot if robot else office / "merged"
    T_world_map = placed(office / "bags", office / "maps", robot or "robot_0").T_reference_estimate
    grid = load_map(folder).grid
    world = load_world(office / "bags")
    assert share_of_cells_as_in(world, grid, T_world_map) >= 0.97
    # Without tolerance it holds for the cells that the building knows; those beyond its walls' lines are left out.
    exact = map_agreement(cell_labels(grid), world.occupancy(grid.geometry, T_world_map))
    assert exact.agree >= 0.97


def test_the_merged_map_contains_the_known_cells_of_all_robots(office):
    merged = load_map(office / "merged")
    areas = [load_map(office / "maps" / robot).grid.is_known().sum() for robot in ROBOTS]
    assert merged.grid.is_known().sum() > 1.2 * max(areas)
    assert [drive.name for drive in merged.drives] == list(ROBOTS)
    assert report(office / "merged")["fusion"]["seen_by_several_m2"] > 200.0


def test_a_merge_can_be_merged(office, tmp_path):
    first = merge_maps(tmp_path / "first", *(office / "maps" / robot for robot in ROBOTS[:2]))
    assert first["frame"] == "robot_0"
    second = merge_maps(tmp_path / "second", tmp_path / "first", office / "maps" / "robot_2")
    # The first merge's frame is robot_0's.
    poses = {"first": "robot_0", "robot_2": "robot_2"}
    T_world_map = {
        name: placed(office / "bags", office / "maps", robot).T_reference_estimate for name, robot in poses.items()
    }
    ((metres, degrees),) = alignment_errors(second, T_world_map, ["robot_2"]).values()
    assert metres <= 0.10
    assert degrees <= 0.5
    assert [drive.name for drive in load_map(tmp_path / "second").drives] == list(ROBOTS)


def test_maps_of_different_buildings_are_refused(office, tmp_path, capsys):
    small = ("--beams", 361, "--rate", 8, "--length", 30)
    for name, more in {
        "office": ("--world", "office", "--seed", 2),
        "store": ("--world", "store", "--seed", 4),
    }.items():
        bag = simulate(tmp_path / name, *more, *small) / "robot_0.bag"
        assert build_maps.main([str(bag), "-o", str(tmp_path / f"{name}-maps")]) == 0
        other = tmp_path / f"{name}-maps" / "robot_0"
        said = merge_maps(tmp_path / f"{name}-merged", office / "maps" / "robot_1", other, status=3)
        assert said["merged"] is False
        (pair,) = said["pairs"]
        assert pair["accepted"] is False
        assert len(pair["reason"]) > 10
        assert all(entry["T_merged_map"] is None and entry["reason"] for entry in said["maps"].values())
        assert not (tmp_path / f"{name}-merged" / "map.npz").exists()
        assert pair["reason"] in capsys.readouterr().out
