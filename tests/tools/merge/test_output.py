"""Where `merge` writes, and what it never overwrites."""

import re
import shutil

import pytest

from tbmslam.io import map_folder
from tools import convert, edit, merge


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_refusal_leaves_nothing_of_an_older_merge(folders, tmp_path, interrupted):
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path)]) == 0
    (tmp_path / "notes.txt").touch()
    if interrupted:
        for name in ("report.json", "report.html", "SHA256SUMS"):
            (tmp_path / name).unlink()
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


@pytest.mark.parametrize("given", ["here", "here/map.npz", "here/map.yaml"])
def test_a_merge_never_overwrites_its_maps(folders, usage_error, given):
    before = (folders / "here" / "map.npz").read_bytes()
    assert "holds one of the maps: choose another folder with -o" in usage_error(
        merge.main, [str(folders / given), str(folders / "there"), "-o", str(folders / "here")]
    )
    assert (folders / "here" / "map.npz").read_bytes() == before


def test_a_merge_does_not_become_one_of_the_folder_of_maps_that_it_is_made_of(folders, tmp_path, usage_error):
    for name in ("here", "there"):
        shutil.copytree(folders / name, tmp_path / name)
    assert "holds one of the maps: choose another folder with -o" in usage_error(
        merge.main, [str(tmp_path), "-o", str(tmp_path)]
    )
    assert not (tmp_path / "map.npz").exists()


def test_a_merge_may_lie_beside_or_above_its_maps(folders, tmp_path):
    for name in ("here", "there"):
        shutil.copytree(folders / name, tmp_path / name)
    assert merge.main([str(tmp_path / "here"), str(tmp_path / "there"), "-o", str(tmp_path)]) == 0
    assert map_folder.load_map(tmp_path).grid.is_known().any()


def test_nothing_is_written_into_a_folder_without_a_name(folders, usage_error):
    assert "is a variable of the shell unset?" in usage_error(
        merge.main, [str(folders / "here"), str(folders / "there"), "-o", ""]
    )


@pytest.mark.parametrize(
    ("files", "fact"),
    [
        (("map.npz", "run.json"), r"holds the map of a robot \(run\.json\), which would be replaced"),
        (("run.json", "report.json"), r"holds the map of a robot"),
        (("map.yaml", "map.pgm"), r"holds map\.yaml, map\.pgm, which no merge wrote and which would be replaced"),
        (("map.npz",), r"holds map\.npz, which no merge wrote"),
        (("map.bag",), r"holds map\.bag, which no merge wrote"),
        (("config.toml",), r"holds config\.toml, which no merge wrote"),
        (("map.npz", "map.yaml", "map.pgm", "edits.toml"), r"holds map\.npz, map\.yaml, map\.pgm, \.\.\., which no"),
        (("metadata.yaml", "run_0.db3"), "is the folder of a ROS bag"),
    ],
)
def test_a_merge_replaces_nothing_but_a_merge(folders, tmp_path, capsys, files, fact):
    for name in files:
        (tmp_path / name).write_text("mine")
    assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert re.fullmatch(rf"merge: \S+: {fact}.*: choose another folder\n", said)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(files, "mine")


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_merge_replaces_an_earlier_merge(folders, tmp_path, interrupted):
    words = [str(folders / "here"), str(folders / "there"), "-o", str(tmp_path), "--occupancy-bag", "mcap"]
    assert merge.main(words) == 0
    if interrupted:
        for name in ("report.json", "report.html", "SHA256SUMS"):
            (tmp_path / name).unlink()
    assert merge.main(words) == 0
    assert (tmp_path / "report.json").is_file()


def test_a_merge_lies_beside_a_recording(folders, tmp_path):
    (tmp_path / "run.mcap").write_text("mine")
    for _ in range(2):
        assert merge.main([str(folders / "here"), str(folders / "there"), "-o", str(tmp_path)]) == 0
    assert (tmp_path / "run.mcap").read_text() == "mine"


def test_a_merge_replaces_no_edited_or_converted_merged_map(folders, tmp_path, capsys):
    both = [str(folders / "here"), str(folders / "there")]
    assert merge.main([*both, "-o", str(tmp_path / "merged")]) == 0
    assert edit.main([str(tmp_path / "merged"), "--rotate", "5", "-o", str(tmp_path / "edited")]) == 0
    assert edit.main([str(tmp_path / "merged"), "--rotate", "5", "-o", str(tmp_path / "unlisted")]) == 0
    (tmp_path / "unlisted" / "SHA256SUMS").unlink()
    assert convert.main([str(tmp_path / "merged"), str(tmp_path / "converted")]) == 0
    for name in ("edited", "unlisted", "converted"):
        before = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        assert merge.main([*both, "-o", str(tmp_path / name)]) == 1
        said = capsys.readouterr().err
        assert re.fullmatch(r"merge: \S+: holds map\.npz, .* no merge wrote .*: choose another folder\n", said)
        assert {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} == before
