"""Edits by hand, and the same again."""

import re
import tomllib

import numpy as np
import pytest

from tbmslam.io.map_folder import load_map, save_map
from tbmslam.map.tbm_map import TbmMap
from tests.tools.build_maps.built_maps import QUICK
from tools import build_maps, edit
from tools.command_line.checksums import changed_files


@pytest.fixture
def room(tmp_path):
    """A room of 3 m by 2 m with walls around it, turned by 20 degrees."""
    cells = np.zeros((40, 60), dtype=np.int8)
    cells[[0, 1, -2, -1]], cells[:, [0, 1, -2, -1]] = 100, 100
    save_map(tmp_path / "room", TbmMap.from_occupancy(cells, 0.05).rotate(np.radians(20.0)))
    return tmp_path / "room"


def run(*words):
    return edit.main([str(word) for word in words])


def test_edits_are_applied_in_their_order_and_can_be_repeated(room, tmp_path, capsys):
    words = ("--align-axes", "--crop", 0.5, 0.5, 2.5, 1.5, "--wall", 1.0, 0.5, 1.0, 1.5, "--erase", 2.0, 0.5, 2.5, 1.0)
    assert run(room, *words, "--keepout", 0.5, 0.5, 1.0, 1.0, "-o", tmp_path / "out") == 0
    out = load_map(tmp_path / "out")
    assert out.grid.geometry.bounds() == pytest.approx((0.5, 0.5, 2.5, 1.5), abs=0.06)
    cells = out.to_occupancy()
    assert (cells[:, 10] == 100).all()
    assert (cells[1:9, 31:39] == -1).all()
    assert (cells[12:, 12:38] == 0).all()
    mask = load_map(tmp_path / "out" / "keepout.yaml").to_occupancy()
    assert (mask[1:9, 1:9] == 100).all()
    assert (mask[11:, 11:] == 0).all()
    kinds = [one["kind"] for one in tomllib.loads((tmp_path / "out" / "edits.toml").read_text())["edit"]]
    assert kinds == ["rotate", "crop", "wall", "erase", "keepout"]
    assert changed_files(tmp_path / "out") == []
    sums = (tmp_path / "out" / "SHA256SUMS").read_text()
    assert all(f"  {name}\n" in sums for name in ("edits.toml", "keepout.yaml", "keepout.pgm"))
    assert run(room, "--edits", tmp_path / "out" / "edits.toml", "-o", tmp_path / "again") == 0
    for name in ("map.npz", "edits.toml", "keepout.pgm"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    assert run(room, "--free", 0, 0, 9, 9, "-o", tmp_path / "out") == 0  # an older mask does not stay
    assert not (tmp_path / "out" / "keepout.yaml").exists()


def test_a_mask_turns_with_the_map(room, tmp_path):
    assert run(room, "--keepout", 0, 0, 1, 1, "--rotate", 90, "-o", tmp_path / "out") == 0
    mask, edited = (load_map(tmp_path / "out" / name).grid.geometry for name in ("keepout.yaml", "map.npz"))
    assert mask == pytest.approx(edited)


def test_a_second_edit_continues_the_list_and_the_mask_of_the_first(room, tmp_path, caplog):
    first = ("--wall", 0.5, 0.5, 0.5, 1.5, "--keepout", 0.2, 0.8, 1.0, 1.6, "--rotate", 13)
    assert run(room, *first, "-o", tmp_path / "k1") == 0
    assert run(tmp_path / "k1", "--rotate", 20, "--crop", -1.5, 0.5, 1.5, 2.5, "-o", tmp_path / "k2") == 0
    assert run(tmp_path / "k2" / "map.npz", "--free", 0, 1, 1, 2, "-o", tmp_path / "k3") == 0
    kinds = [one["kind"] for one in tomllib.loads((tmp_path / "k3" / "edits.toml").read_text())["edit"]]
    assert kinds == ["wall", "keepout", "rotate", "rotate", "crop", "free"]
    assert (load_map(tmp_path / "k3" / "keepout.yaml").to_occupancy() == 100).any()
    assert run(room, "--edits", tmp_path / "k3" / "edits.toml", "-o", tmp_path / "again") == 0
    again, third = load_map(tmp_path / "again").grid, load_map(tmp_path / "k3").grid
    np.testing.assert_array_equal(again.masses, third.masses)
    assert again.geometry == third.geometry
    for name in ("edits.toml", "keepout.yaml", "keepout.pgm"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "k3" / name).read_bytes()


def test_a_second_area_is_forbidden_besides_the_first(room, tmp_path, caplog):
    assert run(room, "--keepout", 0.2, 0.8, 0.6, 1.2, "-o", tmp_path / "k1") == 0
    assert run(tmp_path / "k1", "--keepout", 1.0, 1.0, 1.5, 1.5, "-o", tmp_path / "k2") == 0
    assert not caplog.records  # a mask need not have unknown cells
    first, second = (load_map(tmp_path / name / "keepout.yaml").to_occupancy() == 100 for name in ("k1", "k2"))
    assert second[first].all()
    assert second.sum() > first.sum()


@pytest.mark.parametrize("given", ["k1", "k2"])
def test_edits_that_a_map_already_has_are_not_applied_twice(room, tmp_path, monkeypatch, capsys, given):
    monkeypatch.chdir(tmp_path)
    assert run("room", "--wall", 0.5, 0.5, 0.5, 1.5, "-o", "k1") == 0
    assert run("k1", "--rotate", 5, "-o", "k2") == 0
    for source in ("k1", "k2"):
        capsys.readouterr()
        assert run(source, "--edits", f"{given}/edits.toml", "-o", "out") == 1
        said = f"repeats edits that {source} already has: edit the map without them, or omit --edits"
        assert capsys.readouterr().err == f"edit: {given}/edits.toml: {said}\n"
        assert not (tmp_path / "out").exists()


def test_other_edits_of_a_file_follow_those_of_the_map(room, tmp_path):
    assert run(room, "--wall", 0.5, 0.5, 0.5, 1.5, "-o", tmp_path / "k1") == 0
    assert run(room, "--rotate", 5, "-o", tmp_path / "other") == 0
    assert run(tmp_path / "k1", "--edits", tmp_path / "other" / "edits.toml", "-o", tmp_path / "k2") == 0
    kinds = [one["kind"] for one in tomllib.loads((tmp_path / "k2" / "edits.toml").read_text())["edit"]]
    assert kinds == ["wall", "rotate"]


@pytest.mark.parametrize(
    ("damage", "fact"),
    [
        (
            lambda k1: (k1 / "edits.toml").write_text("edit = 3"),
            r"k1/edits\.toml: holds no list of edits \(.*\): restore",
        ),
        (
            lambda k1: (k1 / "edits.toml").write_bytes(b"\xff"),
            r"k1/edits\.toml: holds no list of edits \(.*\): restore",
        ),
        (
            lambda k1: (k1 / "edits.toml").write_text('[[edit]]\nkind = "wall"\nvalues = [1.0]\n'),
            r"k1/edits\.toml: holds no list of edits \(wall takes 4 numbers, got 1\): restore",
        ),
        (
            lambda k1: (k1 / "keepout.yaml").unlink(),
            r"k1/keepout\.yaml: does not exist, but edits\.toml .*: restore it",
        ),
        (lambda k1: (k1 / "keepout.pgm").write_bytes(b"P5"), r"k1/keepout\.pgm: "),
    ],
)
def test_damaged_edits_of_the_map_are_one_line(room, tmp_path, monkeypatch, capsys, damage, fact):
    monkeypatch.chdir(tmp_path)
    assert run("room", "--keepout", 0.5, 0.5, 1.0, 1.5, "-o", "k1") == 0
    damage(tmp_path / "k1")
    capsys.readouterr()
    assert run("k1", "--rotate", 5, "-o", "k2") == 1
    assert re.fullmatch(f"edit: {fact}.*\n", capsys.readouterr().err)
    assert not (tmp_path / "k2").exists()


def test_edits_are_repeated_on_a_map_that_was_built_again_in_their_folder(bag, tmp_path):
    maps = tmp_path / "maps"
    assert build_maps.main([str(bag), "-o", str(maps), *QUICK]) == 0
    assert run(maps / "robot_0", "--rotate", 5, "-o", tmp_path / "k1") == 0
    (tmp_path / "k1" / "map.npz").write_bytes((maps / "robot_0" / "map.npz").read_bytes())
    assert run(tmp_path / "k1", "--edits", tmp_path / "k1" / "edits.toml", "-o", tmp_path / "k2") == 0
    assert (tmp_path / "k2" / "edits.toml").read_bytes() == (tmp_path / "k1" / "edits.toml").read_bytes()


def test_trajectories_stay_and_scans_go(bag, tmp_path):
    assert build_maps.main([str(bag), "-o", str(tmp_path / "maps"), *QUICK]) == 0
    assert run(tmp_path / "maps" / "robot_0", "--align-axes", "-o", tmp_path / "out") == 0
    before, after = load_map(tmp_path / "maps" / "robot_0").drives[0], load_map(tmp_path / "out").drives[0]
    assert len(after.trajectory) == len(before.trajectory)
    assert len(after.keyframes) == 0


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (("none", "--rotate", "9", "-o", "out"), "none: does not exist: give a map's folder or file"),
        (("room", "--rotate", "9", "-o", "room"), "room/map.npz: is read and would be overwritten: choose another"),
        (("room/map.npz", "--rotate", "9", "-o", "room"), "room/map.npz: is read and would be overwritten"),
        (("room/map.yaml", "--rotate", "9", "-o", "room"), "room/map.yaml: is read and would be overwritten"),
        (("link.npz", "--rotate", "9", "-o", "room"), "link.npz: is read and would be overwritten"),
        (("hall.yaml", "--rotate", "9", "-o", "."), "keepout.pgm: is read and would be overwritten"),
        (
            ("room", "--crop", "50", "50", "60", "60", "-o", "out"),
            r"--crop: \(50, 50\) to .* holds no cell of the map, which reaches from \(-?\d+\.\d\d, .*\) m: correct",
        ),
        (
            ("room", "--erase", "50", "50", "51", "51", "-o", "out"),
            r"--erase: \(50, 50\) to \(51, 51\) m holds no cell",
        ),
        (("room", "--keepout", "50", "50", "51", "51", "-o", "out"), r"--keepout: \(50, 50\) to .* holds no cell"),
        (("room", "--wall", "0", "0", "nan", "1", "-o", "out"), "--wall: the numbers of wall must be within"),
        (("room", "--edits", "none.toml", "-o", "out"), r"none\.toml: cannot be read: No such file"),
        (("room", "--edits", "bad.toml", "-o", "out"), r"bad\.toml: holds no list of edits"),
        (("room", "--edits", "odd.toml", "-o", "out"), "--paint: an edit must be one of crop"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_changes_nothing(room, tmp_path, monkeypatch, capsys, words, fact):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("edit = 3")
    (tmp_path / "link.npz").symlink_to(room / "map.npz")
    (tmp_path / "keepout.pgm").write_bytes((room / "map.pgm").read_bytes())
    (tmp_path / "hall.yaml").write_text((room / "map.yaml").read_text().replace("map.pgm", "keepout.pgm"))
    (tmp_path / "odd.toml").write_text('[[edit]]\nkind = "paint"\nvalues = [1.0]\n')
    before = {path.name: path.read_bytes() for path in room.iterdir()}
    assert run(*words) == 1
    assert re.fullmatch(f"edit: {fact}.*\n", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()
    assert {path.name: path.read_bytes() for path in room.iterdir()} == before


def test_without_an_edit_nothing_is_done(room, usage_error):
    assert "give an edit, such as --align-axes, or a file of --edits" in usage_error(run, room, "-o", "out")
