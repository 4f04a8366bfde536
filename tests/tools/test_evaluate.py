import json
import os

import cv2
import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2, compose
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.trajectory_file import write_tum
from tbmslam.map.tbm_map import TbmMap
from tools.evaluate import main

T_WORLD_MAP = SE2(6.0, 5.0, 0.4)


def run(*arguments):
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Write a world, a map of a part of it in a frame of its own, and a drive in both frames."""
    folder = tmp_path_factory.mktemp("evaluate")
    world = make_world("apartment", 3)
    world.save(folder / "world.npz")
    geometry = GridGeometry(0.05, 0.0, 0.0, 100, 140)
    labels = world.occupancy(geometry, T_WORLD_MAP)
    masses = np.zeros((100, 140, 4), dtype=np.float32)
    masses[..., UNKNOWN] = np.where(labels == UNKNOWN, 1.0, 0.25)
    masses[labels == FREE, FREE] = 0.75
    masses[labels == OCCUPIED, OCCUPIED] = 0.75
    save_map(folder / "map", TbmMap(TbmGrid(geometry, masses)))
    t = np.arange(100) * 0.1
    own = Trajectory(1e9 + t, np.column_stack((1.0 + 0.3 * t, 1.0 + 0.2 * np.sin(t), 0.2 * np.cos(t))))
    write_tum(folder / "est.tum", own)
    write_tum(folder / "gt.tum", own.transformed(T_WORLD_MAP))
    wrong = own.poses.copy()
    wrong[60:, 1] += 0.1
    write_tum(folder / "wrong.tum", Trajectory(own.stamps, wrong))
    relations = (f"{1e9 + k} {1e9 + k + 2.0} {0.6} 0 0 0 0 0" for k in range(8))
    (folder / "true.relations").write_text("\n".join(relations) + f"\n{1e9} {2e9} 0 0 0 0 0 0\n")
    return folder


def test_a_trajectory_against_the_truth(files, tmp_path, capsys):
    picture = tmp_path / "out.png"
    arguments = ["trajectory", files / "wrong.tum", "--truth", files / "gt.tum", "--step-m", 0.5]
    assert run(*arguments, "--json", "--picture", picture, "--map", files / "world.npz") == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["poses"], figures["unmatched"]) == (100, 0)
    assert 0.02 < figures["ate_m"]["rmse"] < 0.05
    assert figures["rpe"]["steps"] == 6
    assert figures["rpe"]["translation_m"]["maximum"] == pytest.approx(0.1, abs=0.01)
    assert figures["rpe"]["rotation_deg"]["maximum"] == pytest.approx(0.0, abs=1e-5)
    drawn = cv2.imread(str(picture))
    colourful = np.ptp(drawn.astype(int), axis=2) > 80
    assert 1000 < colourful.sum() < 0.2 * colourful.size
    assert (drawn == 130).all(axis=2).sum() > 1000


def test_a_map_beneath_lies_in_the_estimates_frame(files, tmp_path):
    arguments = ["trajectory", files / "est.tum", "--truth", files / "gt.tum"]
    assert run(*arguments, "--step-s", 2, "--picture", tmp_path / "out.png", "--map", files / "map") == 0
    assert (cv2.imread(str(tmp_path / "out.png")) == 130).all(axis=2).sum() > 200


def test_a_trajectory_against_relations(files, tmp_path, capsys):
    arguments = ["trajectory", files / "est.tum", "--relations", files / "true.relations"]
    assert run(*arguments, "--picture", tmp_path / "out.png") == 0
    lines = capsys.readouterr().out.splitlines()
    assert "checked: 8" in lines
    assert "unmatched: 1" in lines
    translation = next(line for line in lines if line.startswith("translation_m: "))
    assert [word.split()[0] for word in translation.removeprefix("translation_m: ").split(", ")] == [
        *("rmse", "mean", "standard_deviation", "median", "maximum")
    ]
    assert cv2.imread(str(tmp_path / "out.png")) is not None


def test_a_map_against_its_world(files, tmp_path, capsys):
    x, y, theta = T_WORLD_MAP
    exact = ["map", files / "map", "--truth", files / "world.npz", "--json"]
    assert run(*exact, "--transform", x, y, np.degrees(theta), "--picture", tmp_path / "m.png") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["agree"] > 0.999
    assert figures["known_both"] == figures["known_map"] > 1000
    assert cv2.imread(str(tmp_path / "m.png")).shape[0] == rows_of(files)
    assert run(*exact, "--transform", x + 0.2, y - 0.1, np.degrees(theta) + 1.5) == 0
    off = json.loads(capsys.readouterr().out)
    assert off["agree_occupied"] < 0.7
    assert off["wall_distance_m"] > 0.05
    assert run(*exact, "--transform", x + 0.2, y - 0.1, np.degrees(theta) + 1.5, "--refine") == 0
    refined = json.loads(capsys.readouterr().out)
    assert refined["refined"] is True
    found = refined["T_truth_map"]
    assert (found["x_m"], found["y_m"]) == pytest.approx((x, y), abs=0.02)
    assert found["theta_deg"] == pytest.approx(np.degrees(theta), abs=0.2)
    assert refined["wall_distance_m"] < 0.02
    assert run(*exact, "--trajectories", files / "est.tum", files / "gt.tum") == 0
    assert json.loads(capsys.readouterr().out)["agree"] > 0.999


def draw_plan(folder, world):
    """Write a building's floor plan as a picture: walls black, rooms white, the rest grey."""
    geometry = world.grid(0.05)
    labels = world.occupancy(geometry)
    pixels = np.where(labels == OCCUPIED, 0, np.where(labels == FREE, 254, 205)).astype(np.uint8)
    cv2.imwrite(str(folder / "plan.png"), pixels[::-1])
    (folder / "plan.yaml").write_text(
        f"image: plan.png\nresolution: 0.05\norigin: [{geometry.origin_x}, {geometry.origin_y}, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "plan.yaml"


def test_a_map_is_aligned_with_a_floor_plan_of_unknown_frame(files, tmp_path, capsys):
    plan = draw_plan(tmp_path, make_world("apartment", 3))
    x, y, theta = T_WORLD_MAP
    near = ("--transform", x + 3.0, y - 2.0, np.degrees(theta) + 10.0)
    assert run("map", files / "map", "--truth", plan, "--json", *near, "--align", 6) == 0
    figures = json.loads(capsys.readouterr().out)
    found = figures["T_truth_map"]
    assert (found["x_m"], found["y_m"]) == pytest.approx((x, y), abs=0.02)
    assert found["theta_deg"] == pytest.approx(np.degrees(theta), abs=0.2)
    assert figures["confidence"] > 0.9
    assert figures["wall_distance_m"] < 0.03
    assert figures["agree_nearby"] > 0.98
    for wrong in (("--align", 1), ("--align", 6, "--transform", x, y, 120.0)):
        assert run("map", files / "map", "--truth", plan, *(near if len(wrong) == 2 else ()), *wrong) == 1
        error = capsys.readouterr().err
        assert "of the stated pose is uncertain, confidence 0.0" in error
        best = [float(word) for word in error.partition("it fits best at ")[2].partition(",")[0].split()]
        assert best == pytest.approx([x, y, np.degrees(theta)], abs=0.3)


def test_the_plan_of_another_building_is_refused(files, tmp_path, capsys):
    plan = draw_plan(tmp_path, make_world("office", 1))
    assert run("map", files / "map", "--truth", plan, "--align", 20) == 1
    error = capsys.readouterr().err
    assert "is uncertain, confidence 0." in error
    assert "pass --transform X Y DEG, or check that it is of this floor" in error
    assert error.count("\n") == 1


def rows_of(files):
    return load_map(files / "map").grid.geometry.rows


def test_a_map_against_a_map(files, capsys):
    assert run("map", files / "map", "--truth", files / "map" / "map.npz", "--json", "--refine") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["agree"] == figures["agree_free"] == figures["found_occupied"] == 1.0
    assert figures["wall_distance_m"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("trajectory", "no.tum", "--truth", "gt.tum"), "no.tum: no such file or directory: check the path"),
        (("trajectory", "est.tum", "--truth", "gt.tum", "--step-m", "99"), "less than a step of 99 m"),
        (("map", "map", "--truth", "nothing.npz"), "nothing.npz"),
        (("map", "map", "--truth", "world.npz", "--transform", "900", "0", "0"), "have no common known cell"),
    ],
)
def test_what_is_wrong_with_the_input_is_one_line_and_exit_1(files, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(files)
    assert run(*arguments) == 1
    error = capsys.readouterr().err
    assert error.startswith("evaluate: ")
    assert message in error
    assert error.count("\n") == 1


def test_the_noise_of_the_relations_stands_beside_the_errors(files, tmp_path, capsys):
    """Relations a, b and a + b + 0.03 m in turn: each cycle of three errs by 0.03 m."""
    lines = [
        f"{1e9 + k} {1e9 + k + step} {0.3 * step + (0.03 if step == 2 else 0.0)} 0 0 0 0 0"
        for k in range(60)
        for step in (1, 2)
    ]
    (tmp_path / "cycles.relations").write_text("\n".join(lines) + "\n")
    assert run("trajectory", files / "est.tum", "--relations", tmp_path / "cycles.relations", "--json") == 0
    noise = json.loads(capsys.readouterr().out)["relation_noise"]
    assert noise == {
        "translation_m": pytest.approx(0.03 / 3**0.5),
        "rotation_deg": pytest.approx(0.0),
        "cycles": 60 - 1,
    }


def test_relations_of_another_recording(files, tmp_path, capsys):
    (tmp_path / "other.relations").write_text("5 6 0 0 0 0 0 0\n")
    assert run("trajectory", files / "est.tum", "--relations", tmp_path / "other.relations") == 1
    assert "none of the 1 relations" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("trajectory", "a"), "one of the arguments --truth --relations is required"),
        (("trajectory", "a", "--truth", "b", "--step-m", "0"), "--step-m: must be a number of at least 1e-06"),
        (("trajectory", "a", "--truth", "b", "--step-s", "nan"), "--step-s: must be a number of at least 1e-06"),
        (("trajectory", "a", "--relations", "b", "--step-s", "1"), "relations have steps of their own"),
        (
            ("trajectory", "a", "--truth", "b", "--max-stamp-difference", "-1"),
            "--max-stamp-difference: must be a number of at least 0",
        ),
        (("trajectory", "a", "--truth", "b", "--map", "m"), "--map is the background of a picture: add --picture"),
        (("map", "a", "--truth", "b", "--align", "inf"), "--align: must be a number within 1e-06 and 1e+09, got 'inf'"),
        (
            ("map", "a", "--truth", "b", "--min-evidence", "1"),
            "--min-evidence: must be a number within 0 and 0.999, got '1'",
        ),
    ],
)
def test_wrong_usage_is_exit_2(usage_error, arguments, message):
    assert message in usage_error(run, *arguments)


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [(KeyboardInterrupt, 130, "interrupted"), (MemoryError, 1, "memory has run out: crop the maps")],
)
def test_ctrl_c_and_too_little_memory_are_one_line(tmp_path, monkeypatch, capsys, raised, code, said):
    def give_up(_):
        raise raised

    monkeypatch.setattr("tools.scores.evaluate_map", give_up)
    assert main(["map", str(tmp_path), "--truth", str(tmp_path)]) == code
    assert capsys.readouterr().err.startswith(f"evaluate: {said}")


def test_what_is_no_trajectory_map_or_world_is_one_line(files, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "far.tum").write_text("1 1e9 0 0 0 0 0 1\n")
    (tmp_path / "far.relations").write_text("1 2 1e9 0 0 0 0 0\n")
    (tmp_path / "empty.relations").write_text("")
    with np.load(files / "world.npz") as arrays:
        np.savez(tmp_path / "world.npz", **(dict(arrays) | {"walls": np.full((1, 4), np.nan)}))
    pipe, estimate, own_map = tmp_path / "pipe.npz", files / "est.tum", files / "map"
    for arguments, said in (
        (("trajectory", pipe, "--truth", estimate), "is a device or a pipe: give a trajectory's file"),
        (("trajectory", estimate, "--relations", pipe), "is a device or a pipe: give a file of relations"),
        (
            ("trajectory", tmp_path / "far.tum", "--truth", estimate),
            "the position is more than 1e+08 m away: remove the line, or pass --relations if the file holds",
        ),
        (("trajectory", own_map, "--truth", estimate), f"is a folder: give a trajectory's file, such as {own_map}"),
        (("trajectory", estimate, "--relations", tmp_path / "far.relations"), "a relation is longer than 1e+08 m"),
        (("trajectory", estimate, "--relations", tmp_path / "empty.relations"), "is empty: give a file of relations"),
        (("map", own_map, "--truth", pipe), "is a device or a pipe: give a map's folder or file"),
        (("map", own_map, "--truth", tmp_path / "world.npz"), "world.npz: "),
        (("map", own_map, "--truth", files / "world.npz", "--transform", 1e7, 0, 0), "give the pose of the map in it"),
    ):
        assert run(*arguments) == 1
        line = capsys.readouterr().err
        assert said in line
        assert line.startswith("evaluate: ")
        assert line.count("\n") == 1


def test_a_transform_that_is_no_place_is_wrong_usage(files, usage_error):
    for number in ("nan", "inf", "1e300"):
        assert "--transform must be finite and within 1e+08 m" in usage_error(
            run, "map", files / "map", "--truth", files / "map", "--transform", 0, number, 0
        )


def test_a_truth_of_another_point_is_warned_of_with_the_remedy(tmp_path, caplog):
    """No map beside the estimate states a mount."""
    t = np.arange(100) * 0.1
    own = np.column_stack((1.0 + 0.3 * t, 1.0 + 0.2 * np.sin(t), 0.9 * np.cos(t)))
    write_tum(tmp_path / "est.tum", Trajectory(1e9 + t, own))
    write_tum(tmp_path / "gt.tum", Trajectory(1e9 + t, compose(own, np.array((0.3, 0.1, 0.0)))))
    assert run("trajectory", tmp_path / "est.tum", "--truth", tmp_path / "gt.tum") == 0
    told = "the truth may be of the laser: pass --frame laser --sensor-pose 0.300 0.100 0"
    assert caplog.messages[-1].startswith(f"{tmp_path / 'gt.tum'}: a point +0.300 m ahead and +0.100 m to the left")
    assert caplog.messages[-1].endswith(told)
    caplog.clear()
    options = ("--frame", "laser", "--sensor-pose", 0.3, 0.1, 0)
    assert run("trajectory", tmp_path / "est.tum", "--truth", tmp_path / "gt.tum", *options) == 0
    assert not caplog.messages


def test_a_damaged_map_beside_the_estimate_costs_no_figures(tmp_path, caplog, capsys):
    """The map is asked only for the mount of the laser, by which the remedy is chosen."""
    t = np.arange(100) * 0.1
    own = np.column_stack((1.0 + 0.3 * t, 1.0 + 0.2 * np.sin(t), 0.9 * np.cos(t)))
    write_tum(tmp_path / "est.tum", Trajectory(1e9 + t, own))
    write_tum(tmp_path / "gt.tum", Trajectory(1e9 + t, compose(own, np.array((0.3, 0.1, 0.0)))))
    for name in ("map.yaml", "map.npz"):
        (tmp_path / name).write_text("no map")
    assert run("trajectory", tmp_path / "est.tum", "--truth", tmp_path / "gt.tum") == 0
    assert "ate" in capsys.readouterr().out.lower()
    assert caplog.messages[-1].endswith("pass --frame laser --sensor-pose 0.300 0.100 0")
