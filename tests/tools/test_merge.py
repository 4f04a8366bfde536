import json
import math
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from merging.config import Coverage, Descriptor, MergeConfig, Method, Rule
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan
from tbmslam.resampling import resample
from tbmslam.se2 import SE2
from tbmslam.tbm_map import Drive, TbmMap
from tbmslam.trajectory import Trajectory
from tools import merge

map_folder = pytest.importorskip("tbmslam.files.map_folder")

REPOSITORY = Path(__file__).resolve().parents[2]


def floor(seed):
    """A floor of rooms, 16 m by 12 m."""
    rng = np.random.default_rng(seed)
    masses = np.zeros((240, 320, 4), dtype=np.float32)
    masses[..., 1] = 1.0
    walls = np.zeros((240, 320), dtype=bool)
    walls[[0, 1, -2, -1]] = walls[:, [0, 1, -2, -1]] = True
    for _ in range(8):
        row, col = rng.integers(30, 210), rng.integers(30, 290)
        walls[row : row + 2, max(0, col - rng.integers(20, 90)) : col] = True
        walls[max(0, row - rng.integers(20, 90)) : row, col : col + 2] = True
    masses[walls] = (0.0, 0.0, 1.0, 0.0)
    return TbmGrid(GridGeometry(0.05, 0.0, 0.0, 240, 320), masses)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two robots' maps of one floor, one of another floor, and an empty one."""
    root = tmp_path_factory.mktemp("maps")
    turned = resample(floor(1), SE2(2.0, 3.0, math.radians(70.0)), GridGeometry(0.05, -20.0, -20.0, 900, 900))
    empty = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20))
    for name, grid in {
        "here": floor(1),
        "there": turned.cropped_to_known(),
        "foreign": floor(2),
        "empty": empty,
    }.items():
        map_folder.save_map(root / name, TbmMap(grid))
    return root


def test_a_map_is_laid_where_it_is_told(folders, tmp_path, capsys):
    turned = SE2(2.0, 3.0, math.radians(70.0)).inverse()
    words = [str(turned.x + 0.1), str(turned.y), "-67"]
    given = [str(folders / name) for name in ("here", "there", "foreign")]
    assert merge.main([*given, "-o", str(tmp_path), "--pose", "there", *words]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["pairs"][0]["method"] == "told"
    assert report["maps"]["there"]["T_merged_map"] == pytest.approx(list(turned), abs=0.01)
    assert report["config"]["known_poses"] == {"there": [*map(float, words[:2]), math.radians(-67.0)]}
    assert "there in here: accepted: laid where told, but for 0." in capsys.readouterr().out


def test_a_pose_of_the_first_map_is_refused(folders, tmp_path, capsys):
    given = [str(folders / name) for name in ("here", "there")]
    assert merge.main([*given, "-o", str(tmp_path), "--set", "merging.known_poses.here=[0.0, 0.0, 0.0]"]) == 1
    told = "merge: --pose: poses are told in the frame of here, the first map: tell those of there"
    assert capsys.readouterr().err.strip() == told


def test_a_pose_that_is_no_number_is_wrong_usage(folders, tmp_path, capsys):
    given = [str(folders / name) for name in ("here", "there")]
    with pytest.raises(SystemExit, match="2"):
        merge.main([*given, "-o", str(tmp_path), "--pose", "there", "1", "two", "3"])
    assert "--pose must look like NAME X Y DEG, as robot_1 12.5 -3 90, got there 1 two 3" in capsys.readouterr().err


def test_two_maps_become_one_in_a_folder_like_any_other(folders, tmp_path, capsys):
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path / "merged")]) == 0
    merged = map_folder.load_map(tmp_path / "merged")
    assert merged.grid.is_known().sum() == pytest.approx(240 * 320, rel=0.03)
    report = json.loads((tmp_path / "merged" / "report.json").read_text())
    assert report["pairs"][0]["accepted"] is True
    x, y, theta = SE2(2.0, 3.0, math.radians(70.0)).inverse()
    assert report["maps"]["there"]["T_merged_map"] == pytest.approx([x, y, theta], abs=0.05)
    assert {
        "report.json",
        "report.html",
        "overlay.png",
        "contradictions.png",
        "conflict.png",
        "map.npz",
        "map.yaml",
        "map.pgm",
    } <= {path.name for path in (tmp_path / "merged").iterdir()}
    said = capsys.readouterr().out
    assert "there in here: accepted: " in said
    assert f"report -> {tmp_path / 'merged' / 'report.html'}" in said


def test_a_merge_is_merged_with_a_map_file(folders, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(first)]) == 0
    assert merge.main([str(first / "map.npz"), str(folders / "there" / "map.yaml"), "-o", str(second)]) == 0
    assert list(json.loads((second / "report.json").read_text())["maps"]) == ["first", "there"]


def test_a_foreign_map_is_left_out_and_named(folders, tmp_path, capsys):
    names = [str(folders / name) for name in ("foreign", "here", "there")]
    assert merge.main([*names, "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "left out: foreign: no alignment with a merged map was accepted" in said
    assert "whoever knows where one lies may say so: --pose NAME X Y DEG, in the first map's frame\n" in said
    assert json.loads((tmp_path / "report.json").read_text())["frame"] == "here"


@pytest.mark.parametrize(("other", "reason"), [("foreign", ""), ("empty", "the source map is empty")])
def test_nothing_to_merge_is_status_3_with_a_report(folders, tmp_path, capsys, other, reason):
    assert merge.main([str(folders / "here"), str(folders / other), "-o", str(tmp_path)]) == 3
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["merged"] is False
    assert reason in report["pairs"][0]["reason"]
    assert not (tmp_path / "map.npz").exists()
    assert f"nothing merged; the reasons are in {tmp_path / 'report.html'}" in capsys.readouterr().out


def test_a_refusal_leaves_nothing_of_an_older_merge(folders, tmp_path):
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path)]) == 0
    (tmp_path / "notes.txt").touch()
    assert merge.main([str(folders / "here"), str(folders / "foreign"), "-o", str(tmp_path)]) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("SHA256SUMS", "config.toml", "notes.txt", "report.html", "report.json")
    ]


def test_a_link_to_a_map_does_not_let_it_be_overwritten(folders, tmp_path, capsys):
    (tmp_path / "link.npz").symlink_to(folders / "here" / "map.npz")
    with pytest.raises(SystemExit):
        merge.main([str(tmp_path / "link.npz"), str(folders / "there"), "-o", str(folders / "here")])
    assert "holds one of the maps: choose another folder with -o" in capsys.readouterr().err


def test_the_picture_of_a_map_is_not_overwritten(folders, tmp_path, capsys):
    shutil.copy(folders / "here" / "map.pgm", tmp_path)
    before = (tmp_path / "map.pgm").read_bytes()
    (tmp_path / "hall.yaml").write_text((folders / "here" / "map.yaml").read_text())
    assert merge.main([str(tmp_path / "hall.yaml"), str(folders / "there"), "-o", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert re.search(
        r"merge: .*map\.pgm: belongs to .*hall\.yaml and would be overwritten: choose another folder", said
    )
    assert (tmp_path / "map.pgm").read_bytes() == before
    assert not (tmp_path / "map.npz").exists()


def test_a_map_that_is_given_twice_is_told(folders, tmp_path, caplog):
    merge.main([str(folders / "empty"), str(folders / "empty" / "map.npz"), "-o", str(tmp_path / "merged")])
    assert "map.npz: is given twice, and counts as two robots that saw the same" in caplog.text


def test_a_drive_that_is_given_under_two_paths_is_told(tmp_path, caplog):
    scans = [LaserScan(0.1 * k, -1.0, 0.5, 0.1, 30.0, np.full(5, 1.0 + k)) for k in range(6)]
    keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * 6] * 2)
    drive = Drive("robot", Trajectory(keyframes.stamps, keyframes.poses), keyframes)
    map_folder.save_map(tmp_path / "drive", TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 20, 20)), (drive,)))
    shutil.copytree(tmp_path / "drive", tmp_path / "copy")
    merge.main([str(tmp_path / "drive"), str(tmp_path / "copy"), "-o", str(tmp_path / "merged")])
    assert "drive and copy hold the same scans, 6 of 6 keyframes: one drive counts as two robots" in caplog.text


@pytest.mark.parametrize("given", ["here", "here/map.npz", "here/map.yaml"])
def test_a_merge_never_overwrites_its_maps(folders, capsys, given):
    before = (folders / "here" / "map.npz").read_bytes()
    with pytest.raises(SystemExit) as stopped:
        merge.main([str(folders / given), str(folders / "there"), "-o", str(folders / "here")])
    assert stopped.value.code == 2
    assert "holds one of the maps: choose another folder with -o" in capsys.readouterr().err
    assert (folders / "here" / "map.npz").read_bytes() == before


def test_a_merge_does_not_become_one_of_the_folder_of_maps_that_it_is_made_of(folders, tmp_path, capsys):
    for name in ("here", "there"):
        shutil.copytree(folders / name, tmp_path / name)
    with pytest.raises(SystemExit) as stopped:
        merge.main([str(tmp_path), "-o", str(tmp_path)])
    assert stopped.value.code == 2
    assert "holds one of the maps: choose another folder with -o" in capsys.readouterr().err
    assert not (tmp_path / "map.npz").exists()


def test_a_merge_may_lie_beside_or_above_its_maps(folders, tmp_path):
    for name in ("here", "there"):
        shutil.copytree(folders / name, tmp_path / name)
    assert merge.main([str(tmp_path / "here"), str(tmp_path / "there"), "-o", str(tmp_path)]) == 0
    assert map_folder.load_map(tmp_path).grid.is_known().any()


def test_the_options_reach_the_merge(folders, tmp_path):
    chosen = [
        "--method", "features", "--rule", "conjunctive", "--coverage", "overlap", "--keypoints", "800",
        "--ratio", "0.8", "--descriptor", "pignistic", "--min-inliers", "6", "--resolution", "0.1",
        "--compare-at", "0.06",
    ]  # fmt: skip
    merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path), *chosen])
    config = json.loads((tmp_path / "report.json").read_text())["config"]
    assert {key: config[key] for key in ("method", "rule", "coverage", "resolution", "merged_resolution")} == {
        "method": "features",
        "rule": "conjunctive",
        "coverage": "overlap",
        "resolution": 0.06,
        "merged_resolution": 0.1,
    }
    assert (config["features"]["keypoints"], config["features"]["ratio"], config["features"]["descriptor"]) == (
        800,
        0.8,
        "pignistic",
    )
    assert config["consensus"]["min_inliers"] == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "out"], "two maps or more are needed, got 0: name their folders, as out/robot_0 out/robot_1"),
        (
            ["one", "-o", "out"],
            "error: one: does not exist: name their folders, as out/robot_0 out/robot_1, or a folder",
        ),
        (
            ["one", "two", "-o", "out", "--ratio", "7"],
            "merging.features.ratio: Input should be less than or equal to 1 (got 7.0)",
        ),
        (
            ["one", "two", "-o", "out", "--resolution", "0"],
            "merging.merged_resolution: Input should be greater than 0 (got 0.0)",
        ),
        (["one", "two", "-o", "out", "--method", "guess"], "invalid choice: 'guess'"),
        (["one", "two"], "required: -o/--out"),
    ],
)
def test_wrong_usage_is_status_2(capsys, arguments, message):
    with pytest.raises(SystemExit) as stopped:
        merge.main(arguments)
    assert stopped.value.code == 2
    assert message in capsys.readouterr().err


def test_a_folder_with_one_map_or_none_is_told_apart(tmp_path, capsys):
    for folder in ("empty", "single/robot_0"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "single" / "robot_0" / "map.npz").touch()
    for name, message in (
        ("empty", "empty: holds no map: name a folder that build_maps wrote with -o"),
        ("single", "two maps or more are needed, "),
        ("single", "single is or holds only one: name their folders, as out/robot_0 out/robot_1"),
        ("single/robot_0", "single/robot_0 is or holds only one"),
    ):
        with pytest.raises(SystemExit) as stopped:
            merge.main([str(tmp_path / name), "-o", str(tmp_path / "out")])
        assert stopped.value.code == 2
        assert message in capsys.readouterr().err


def test_a_map_that_is_not_there_is_one_line_and_status_1(tmp_path, capsys):
    assert merge.main([str(tmp_path / "one"), str(tmp_path / "two"), "-o", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("merge: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["out/robot_0", "out/robot_1"], ["robot_0", "robot_1"]),
        (["a/robot_0", "b/robot_0", "b/robot_1"], ["a/robot_0", "b/robot_0", "b/robot_1"]),
        (["robot_0/map.npz", "robot_1/map.yaml", "hall.yaml"], ["robot_0", "robot_1", "hall"]),
        (["robot_0", "robot_0/map.npz"], ["robot_0", "robot_0#2"]),
    ],
)
def test_maps_have_names_of_their_own(paths, names):
    assert merge.unique_names([Path(path) for path in paths]) == names


def test_the_choices_are_the_library_s():
    assert get_args(Method) == merge.METHODS
    assert get_args(Rule) == merge.RULES
    assert get_args(Coverage) == merge.COVERAGES
    assert get_args(Descriptor) == merge.DESCRIPTORS


def test_help_answers_at_once():
    start = time.perf_counter()
    command = [sys.executable, "tools/merge.py", "--help"]
    answer = subprocess.run(  # noqa: S603  our own program
        command, cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert time.perf_counter() - start < 2.0  # 0.05 s on an idle machine
    assert "exit codes: 0 merged" in answer.stdout
    loaded = "import sys; import tools.merge; print({'cv2', 'numba', 'scipy', 'pydantic'} & set(sys.modules))"
    answer = subprocess.run(  # noqa: S603  our own program
        [sys.executable, "-c", loaded], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (["there", "nan", "0", "0"], "--pose must be within 10000 m of the first map, at any angle, got there nan 0 0"),
        (
            ["there", "0", "-1e5", "0"],
            "--pose must be within 10000 m of the first map, at any angle, got there 0 -1e5 0",
        ),
        (["there", "0", "0", "inf"], "--pose must be within 10000 m of the first map, at any angle, got there 0 0 inf"),
        (
            ["there", "0", "0", "0", "--pose", "there", "9", "0", "0"],
            "--pose tells two poses of there, got there 9 0 0",
        ),
    ],
)
def test_poses_that_cannot_be_meant_are_wrong_usage(folders, tmp_path, capsys, words, fact):
    given = [str(folders / name) for name in ("here", "there")]
    with pytest.raises(SystemExit, match="2"):
        merge.main([*given, "-o", str(tmp_path), "--pose", *words])
    assert fact in capsys.readouterr().err


def test_no_pose_is_farther_than_the_parameters_allow():
    MergeConfig(known_poses={"there": (merge.FARTHEST_POSE, 0.0, 0.0)})
    with pytest.raises(ValueError, match="less than or equal to 10000"):
        MergeConfig(known_poses={"there": (1.001 * merge.FARTHEST_POSE, 0.0, 0.0)})


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (("here", "there", "--resolution", "1e-9"), "merge: cells of 1e-09 m are not within 0.001 to 100 m"),
        (("here", "there", "--resolution", "1e300"), r"merge: cells of 1e\+300 m are not within"),
        (("here", "there", "--compare-at", "1e9"), r"merge: cells of 1e\+09 m are not within"),
        (("here", "nano"), r"merge: \S*/nano/map\.npz: cells of 1e-09 m are not within 0.001 to 100 m: correct the"),
        (("nano", "here"), r"merge: \S*/nano/map\.npz: cells of 1e-09 m"),
        (("here", "vast"), r"merge: \S*/vast/map\.npz: cells of 10000 m are not within"),
        (
            ("here", "wide", "--compare-at", "0.002"),
            "merge: wide: a map of 7.92e.03 x .* m is too large for cells of 0.002",
        ),
        (("here", "there", "--config", "/dev/zero"), "merge: /dev/zero: cannot be read as TOML: it is no file"),
        (
            ("here", "there", "--reliability", "nobody=0.5"),
            "merge: --reliability: 'nobody' is none of the maps, which",
        ),
        (
            ("here", "there", "--pose", "nobody", "0", "0", "0"),
            "merge: --pose: 'nobody' is none of the maps, which are",
        ),
        (("here", "new\nline/none"), "merge: .*new line/none: does not exist"),
    ],
)
def test_odd_sizes_and_names_are_one_line(folders, tmp_path, capsys, words, fact):
    for name, resolution in (("nano", 1e-9), ("vast", 1e4), ("wide", 99.0)):
        masses = np.tile(np.array([0, 0, 1, 0], dtype=np.float32), (60, 80, 1))
        map_folder.save_map(tmp_path / name, TbmMap(TbmGrid(GridGeometry(resolution, 0.0, 0.0, 60, 80), masses)))
    places = {
        "here": folders,
        "there": folders,
        "nano": tmp_path,
        "vast": tmp_path,
        "wide": tmp_path,
        "new\nline/none": tmp_path,
    }
    given = [str(places[word] / word) if word in places else word for word in words]
    assert merge.main([*given, "-o", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert re.match(fact, said)
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_links_in_a_circle_lead_nowhere(folders, tmp_path, capsys):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert merge.main([str(folders / "here"), str(loop), "-o", str(tmp_path / "out")]) == 1
    assert re.match(r"merge: \S+: does not exist: give a map's folder or file\n$", capsys.readouterr().err)
    assert merge.main([str(folders / "here"), str(loop / "robot_0"), "-o", str(tmp_path / "out")]) == 1
    assert re.match(r"merge: \S+: does not exist: give a map's folder or file\n$", capsys.readouterr().err)
    with pytest.raises(SystemExit) as stopped:
        merge.main([str(folders / "here"), str(folders / "there"), "-o", str(loop / "out")])
    assert stopped.value.code == 2
    assert "the maps cannot be listed: Symlink loop" in capsys.readouterr().err


def test_an_empty_text_is_no_map(folders, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        merge.main([str(folders / "here"), "", "-o", str(tmp_path / "out")])
    assert stopped.value.code == 2
    assert "an empty text names no file" in capsys.readouterr().err


def test_nothing_is_written_into_a_folder_without_a_name(folders, capsys):
    with pytest.raises(SystemExit) as stopped:
        merge.main([str(folders / "here"), str(folders / "there"), "-o", ""])
    assert stopped.value.code == 2
    assert "is a variable of the shell unset?" in capsys.readouterr().err
