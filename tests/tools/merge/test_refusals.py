"""What `merge` refuses: one line, and an exit code that says whose fault it is."""

import re

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.io import map_folder
from tbmslam.map.tbm_map import TbmMap
from tools import merge


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "out"], "two maps or more are needed, got 0: give their folders, such as out/robot_0 out/robot_1"),
        (
            ["none", "-o", "out"],
            "error: none: does not exist: give their folders, such as out/robot_0 out/robot_1, or a folder",
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
def test_wrong_usage_is_status_2(usage_error, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        (tmp_path / name).touch()
    assert message in usage_error(merge.main, arguments)


def test_a_folder_with_one_map_or_none_is_refused(tmp_path, usage_error):
    for folder in ("empty", "single/robot_0"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "single" / "robot_0" / "map.npz").touch()
    for name, message in (
        ("empty", "empty: holds no map: name a folder that `tbmslam map` wrote with -o"),
        ("single", "two maps or more are needed, "),
        ("single", "single is or holds only one: give their folders, such as out/robot_0 out/robot_1"),
        ("single/robot_0", "single/robot_0 is or holds only one"),
    ):
        (tmp_path / "single" / "robot_0" / "map.yaml").touch()
        said = usage_error(merge.main, [str(tmp_path / name), "-o", str(tmp_path / "out")])
        assert message in said
        assert ".yaml" not in said


@pytest.mark.parametrize("names", [("hall.yaml", "lab.yaml"), ("map.yaml", "lab.yml")])
def test_a_folder_of_maps_of_other_programs_needs_their_names(tmp_path, usage_error, names):
    for name in names:
        (tmp_path / name).touch()
    first, second = sorted(tmp_path / name for name in names)
    said = usage_error(merge.main, [str(tmp_path), "-o", str(tmp_path / "out")])
    assert f", or give the .yaml files, such as {first} {second} (" in said


def test_a_map_that_is_not_there_is_one_line_and_status_1(tmp_path, capsys):
    assert merge.main([str(tmp_path / "one"), str(tmp_path / "two"), "-o", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("merge: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


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
            ("here", "wide", "--compare-at", "0.02"),
            "merge: wide: a map of 7.92e.03 x .* m is too large for cells of 0.02",
        ),
        (
            ("here", "there", "--config", "/dev/zero"),
            "merge: /dev/zero: cannot be read as TOML: it is a device or a pipe",
        ),
        (
            ("here", "there", "--reliability", "nobody=0.5"),
            "merge: --reliability: 'nobody' is not one of the maps, which",
        ),
        (
            ("here", "there", "--pose", "nobody", "0", "0", "0"),
            "merge: --pose: 'nobody' is not one of the maps, which are",
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


def test_links_in_a_circle_lead_nowhere(folders, tmp_path, capsys, usage_error):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert merge.main([str(folders / "here"), str(loop), "-o", str(tmp_path / "out")]) == 1
    assert re.match(r"merge: \S+: does not exist: give a map's folder or file\n$", capsys.readouterr().err)
    assert merge.main([str(folders / "here"), str(loop / "robot_0"), "-o", str(tmp_path / "out")]) == 1
    assert re.match(r"merge: \S+: does not exist: give a map's folder or file\n$", capsys.readouterr().err)
    assert "the maps cannot be listed: Symlink loop" in usage_error(
        merge.main, [str(folders / "here"), str(folders / "there"), "-o", str(loop / "out")]
    )


def test_an_empty_text_is_no_map(folders, tmp_path, usage_error):
    assert "the name of a file is empty" in usage_error(
        merge.main, [str(folders / "here"), "", "-o", str(tmp_path / "out")]
    )
