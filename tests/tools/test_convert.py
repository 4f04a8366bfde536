"""Every format through the program, and back where it is read."""

import re

import cv2
import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.map.tbm_map import TbmMap
from tests.tools.build_maps.built_maps import QUICK
from tools import build_maps, convert, edit
from tools.command_line.checksums import changed_files


@pytest.fixture
def plan(tmp_path):
    """A map folder of random cells."""
    cells = np.random.default_rng(2).choice([-1, 0, 100], (30, 40)).astype(np.int8)
    save_map(tmp_path / "plan", TbmMap.from_occupancy(cells, 0.05, (-1.0, 2.0)))
    return tmp_path / "plan"


def run(*words):
    return convert.main([str(word) for word in words])


@pytest.mark.parametrize("name", ["copy", "map.npz", "map.yaml", "map.tif", "map.bag", "map.mcap", "map.tbm_map"])
def test_each_format_leads_back_to_the_same_cells(plan, tmp_path, name, capsys):
    if name.endswith(".tif"):
        pytest.importorskip("rasterio", reason="rasterio is not installed")
    assert run(plan, tmp_path / name) == 0
    assert capsys.readouterr().out == f"{plan}: 40 x 30 cells of 0.05 m, 2.0 m2 known -> {tmp_path / name}\n"
    assert run(tmp_path / name, tmp_path / "back.npz") == 0
    before, after = load_map(plan), load_map(tmp_path / "back.npz")
    assert after.grid.geometry == pytest.approx(before.grid.geometry)
    np.testing.assert_array_equal(after.to_occupancy(), before.to_occupancy())
    np.testing.assert_allclose(after.grid.masses, before.grid.masses, atol=1e-6)


def test_a_map_that_replaces_an_edited_one_has_no_edits(plan, tmp_path):
    words = (plan, "--keepout", -1, 2, 0, 3, "-o", tmp_path / "edited")
    assert edit.main([str(word) for word in words]) == 0
    assert run(plan, tmp_path / "edited") == 0
    assert not {"edits.toml", "keepout.yaml", "keepout.pgm"} & {file.name for file in (tmp_path / "edited").iterdir()}
    assert changed_files(tmp_path / "edited") == []


@pytest.mark.parametrize(
    ("files", "fact"),
    [
        (("map.npz", "SHA256SUMS", "run.json"), r"holds the map of a robot \(run\.json\), which would be replaced"),
        (("map.npz", "SHA256SUMS", "report.json"), r"holds a merged map \(report\.json\), which would be replaced"),
        (("map.yaml", "map.pgm"), r"holds map\.yaml, map\.pgm, which would be replaced"),
        (("map.bag",), r"holds map\.bag, which would be replaced"),
        (("config.toml",), r"holds config\.toml, which would not belong to the new map"),
        (("metadata.yaml", "run_0.db3"), "is the folder of a ROS bag"),
    ],
)
@pytest.mark.parametrize("program", ["convert", "edit"])
def test_a_folder_of_other_results_is_refused(plan, tmp_path, capsys, files, fact, program):
    out = tmp_path / "other"
    out.mkdir()
    for name in files:
        (out / name).write_text("mine")
    code = run(plan, out) if program == "convert" else edit.main([str(plan), "--rotate", "5", "-o", str(out)])
    assert code == 1
    assert re.fullmatch(rf"{program}: \S+: {fact}.*: choose another folder\n", capsys.readouterr().err)
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(files, "mine")


@pytest.mark.parametrize("program", ["convert", "edit"])
def test_a_map_replaces_a_converted_or_edited_one(plan, tmp_path, program):
    assert run(plan, tmp_path / "out") == 0
    mine = ("notes.txt", "config.toml", "overlay.png", "report.html", "run.mcap")
    for name in mine:
        (tmp_path / "out" / name).write_text("mine")
    words = [str(plan), "--rotate", "5", "-o", str(tmp_path / "out")]
    for _ in range(2):
        assert (run(plan, tmp_path / "out") if program == "convert" else edit.main(words)) == 0
    assert changed_files(tmp_path / "out") == []
    assert {(tmp_path / "out" / name).read_text() for name in mine} == {"mine"}


@pytest.mark.parametrize("program", ["convert", "edit"])
def test_an_unfinished_map_is_to_be_deleted(plan, tmp_path, capsys, program):
    words = [str(plan), "--rotate", "5", "-o", str(tmp_path / "out")]
    for code in (0, 1):
        assert (run(plan, tmp_path / "out") if program == "convert" else edit.main(words)) == code
        (tmp_path / "out" / "SHA256SUMS").unlink(missing_ok=True)
    said = capsys.readouterr().err
    fact = r"holds an unfinished result or a map of other origin \(map\.npz without SHA256SUMS\)"
    remedy = "which would be replaced: delete it, or choose another folder"
    assert re.fullmatch(rf"{program}: \S+: {fact}, {remedy}\n", said)


@pytest.mark.parametrize("name", ["map.bag", "keepout.yaml"])
def test_a_file_that_is_read_is_not_removed(plan, tmp_path, capsys, name):
    assert run(plan, tmp_path / "out" / name) == 0
    assert run(tmp_path / "out" / name, tmp_path / "out") == 1
    assert f"{name}: is read and would be overwritten" in capsys.readouterr().err
    assert (tmp_path / "out" / name).exists()


def test_a_picture_needs_the_size_of_its_pixels(plan, tmp_path, capsys):
    picture = np.full((10, 20), 205, dtype=np.uint8)
    picture[2], picture[5] = 0, 255
    cv2.imwrite(str(tmp_path / "plan.png"), picture)
    assert run(tmp_path / "plan.png", tmp_path / "out") == 1
    assert "plan.png: a picture holds no size of its pixels: pass --resolution" in capsys.readouterr().err
    assert run(tmp_path / "plan.png", tmp_path / "out", "--resolution", 0.1, "--origin", -3, 4) == 0
    made = load_map(tmp_path / "out")
    assert made.grid.geometry == pytest.approx((0.1, -3.0, 4.0, 10, 20))
    assert (made.to_occupancy()[7] == 100).all()
    for words in (("--resolution", 0.1), ("--origin", -3, 4), ("--origin", 0, 0)):
        assert run(plan, tmp_path / "x", *words) == 1
        assert "is not a picture and states its cells: drop --resolution and --origin" in capsys.readouterr().err


def test_a_world_file_beside_a_picture_states_where_it_lies(plan, tmp_path, capsys):
    assert run(plan, tmp_path / "again.png") == 0
    assert cv2.imread(str(tmp_path / "again.png"), cv2.IMREAD_UNCHANGED).shape == (30, 40)
    assert run(tmp_path / "again.png", tmp_path / "back") == 0
    before, after = load_map(plan), load_map(tmp_path / "back")
    assert after.grid.geometry == pytest.approx(before.grid.geometry)
    np.testing.assert_array_equal(after.to_occupancy(), before.to_occupancy())
    assert run(tmp_path / "again.png", tmp_path / "other", "--resolution", 0.1) == 0  # what is typed counts
    assert load_map(tmp_path / "other").grid.geometry == pytest.approx((0.1, 0.0, 0.0, 30, 40))
    capsys.readouterr()
    assert run(tmp_path / "again.png", tmp_path / "third", "--origin", 0, 0) == 1
    assert "again.png: its world file states the origin: drop --origin, or pass --resolution" in capsys.readouterr().err
    for text in ("0.05\n0\n0\n-0.05\n1\n", "0.05\n0.01\n0\n-0.05\n1\n2\n", "0.05\n0\n0\n-0.06\n1\n2\n", "a\n" * 6):
        (tmp_path / "again.pgw").write_text(text)
        assert run(tmp_path / "again.png", tmp_path / "back") == 1
        assert "again.pgw: is no world file of square pixels without rotation" in capsys.readouterr().err


def test_cells_of_middling_belief_survive_a_picture(tmp_path):
    masses = np.zeros((3, 20, 4), dtype=np.float32)
    masses[0, :, FREE] = masses[1, :, OCCUPIED] = np.linspace(0.0, 1.0, 20)
    masses[..., UNKNOWN] = 1.0 - masses.sum(axis=-1)
    before = TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 3, 20), masses))
    save_map(tmp_path / "sure", before)
    assert run(tmp_path / "sure", tmp_path / "map.png") == 0
    assert run(tmp_path / "map.png", tmp_path / "back.npz") == 0
    after = load_map(tmp_path / "back.npz")
    np.testing.assert_array_equal(after.to_occupancy(), before.to_occupancy())
    assert (before.to_occupancy()[0] == 0).sum() > (masses[0, :, FREE] > 0.65).sum() > 0  # the pignistic picture's


def test_a_bag_keeps_the_size_of_its_cells(plan, tmp_path):
    assert run(plan, tmp_path / "map.bag") == 0
    assert run(tmp_path / "map.bag", tmp_path / "back.npz") == 0
    assert load_map(tmp_path / "back.npz").grid.geometry.resolution == 0.05  # a message states a float32


@pytest.mark.parametrize("name", ["m.yml", "hall.yaml"])
def test_a_yaml_is_written_under_its_own_name(plan, tmp_path, name):
    (tmp_path / "hall").mkdir()
    assert run(plan, tmp_path / name) == 0
    assert load_map(tmp_path / name).grid.geometry == pytest.approx(load_map(plan).grid.geometry)
    assert sorted(path.stem for path in tmp_path.glob("*.*")) == [name.partition(".")[0]] * 2
    assert not any((tmp_path / "hall").iterdir())


def test_a_pose_graph_is_not_read(tmp_path, capsys):
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    assert run(tmp_path / "graph.g2o", tmp_path / "out") == 1
    assert "graph.g2o: is only written, not read: give a map's folder or file" in capsys.readouterr().err


def test_keyframes_become_a_pose_graph(bag, plan, tmp_path, capsys):
    assert build_maps.main([str(bag), "-o", str(tmp_path / "maps"), *QUICK]) == 0
    assert run(tmp_path / "maps" / "robot_0", tmp_path / "graph.g2o") == 0
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    (drive,) = load_map(tmp_path / "maps" / "robot_0").drives
    assert sum(line.startswith("VERTEX_SE2 ") for line in lines) == len(drive.keyframes) > 5
    edges = [line.split() for line in lines if line.startswith("EDGE_SE2 ")]
    assert [len(edge) for edge in edges] == [12] * (len(drive.keyframes) - 1)
    capsys.readouterr()
    assert run(plan, tmp_path / "none.g2o") == 1
    assert "none.g2o: the map has no keyframes to write" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "fact"),
    [
        (("none", "out"), "none: does not exist: give a map's folder or file"),
        (("plan", "plan"), "plan/map.npz: is read and would be overwritten: choose another folder or name"),
        (("plan/map.npz", "plan"), "plan/map.npz: is read and would be overwritten"),
        (("plan/map.yaml", "plan"), "plan/map.yaml: is read and would be overwritten"),
        (("hall.yaml", "hall.png"), "hall.png: is read and would be overwritten"),
        (("hall.yaml", "hall.yaml"), "hall.yaml: is read and would be overwritten"),
        (("picture.pgm", "picture.yaml", "--resolution", "0.1"), "picture.pgm: is read and would be overwritten"),
        (("plan", "out.svg"), r"out\.svg: no format has the suffix \.svg: choose of \.npz, "),
        (("a.bag", "out"), r"a\.bag: "),
        (("a.tif", "out"), r"a\.tif: "),
    ],
)
def test_what_cannot_be_converted_is_one_line(plan, tmp_path, monkeypatch, capsys, words, fact):
    monkeypatch.chdir(tmp_path)
    for name in ("a.bag", "a.tif"):
        (tmp_path / name).write_bytes(b"no map")
    for name in ("hall.png", "picture.pgm"):
        cv2.imwrite(str(tmp_path / name), np.full((10, 20), 254, dtype=np.uint8))
    (tmp_path / "hall.yaml").write_text((plan / "map.yaml").read_text().replace("map.pgm", "hall.png"))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    assert run(*words) == 1
    assert re.fullmatch(f"convert: {fact}.*\n", capsys.readouterr().err)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
    assert not (tmp_path / "out").exists()


def test_a_bag_without_a_map_or_with_a_damaged_one(bag, tmp_path, capsys):
    assert run(bag, tmp_path / "out") == 1
    assert "holds no OccupancyGrid topics: it must hold exactly one" in capsys.readouterr().err
