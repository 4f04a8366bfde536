import json
import math
import os

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import building_of_world, cut_pairs, disjoint_pair, room_of
from merging.baselines import howard
from merging.scoring import FEATURES, MEASURES
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tools import benchmark, calibrate_merging, make_map_pairs
from tools.benchmarks.align import PairResult, comparison, details, encounters_of, summary
from tools.calibration.calibration_report import BINS, calibration_table
from tools.map_pairs.known_pair import KnownPair, PairFileError, load_pair

# One worker makes the pairs for all of them.
pytestmark = pytest.mark.xdist_group("known pairs")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    building = room_of(building_of_world("apartment", 2), 90.0, 1)
    for pair in [*cut_pairs(building, 1, (1.0, 0.5)), disjoint_pair(building, 1)]:
        pair.save(folder)
    return folder


def result(overlap, confidence, right, accepted):
    return PairResult("pair", overlap, accepted, right, False, confidence, 0.02, 0.1, 4.0, 0.0, 0.3, "because")


def test_the_table_counts_right_wrong_and_negatives():
    results = [
        result(100, 0.99, True, True),
        result(100, 0.5, True, False),
        result(35, 0.95, False, True),
        result(None, 0.8, False, True),
        result(None, 0.1, False, False),
    ]
    columns, (row,) = summary(results, "correlation")
    assert row[:6] == ["correlation", "5", "1/2", "0/1", "1", "1 of 2"]
    found = dict(zip(columns, row, strict=True))
    assert [found[name] for name in ("error m", "in deviations", "CPU s", "bent")] == ["0.020", "2.00", "0.30", "0"]
    assert "0.50 to 0.70 | 1     |       0.500 |        1.000" in calibration_table(results, BINS)
    assert details(results[:1]) == "all decisions are right"
    assert details(results).count("because") == 3


def test_pairs_are_aligned_and_listed(folder, tmp_path, capsys):
    figures = tmp_path / "figures.json"
    assert benchmark.main(["align", str(folder), "--json", str(figures), "--details"]) == 0
    assert "negatives accepted" in capsys.readouterr().out
    pairs = {pair["name"]: pair for pair in json.loads(figures.read_text())["methods"]["correlation"]}
    assert len(pairs) == 3
    assert all(pair["right"] for name, pair in pairs.items() if name.endswith("100"))


def test_several_methods_share_one_table(folder, capsys):
    assert benchmark.main(["align", str(folder), "--method", "trehard,howard"]) == 0
    table = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    rows = {row[0]: row[1:] for row in ([cell.strip() for cell in line.split("|")[1:-1]] for line in table)}
    assert rows["method"][2:6] == ["all", "wrong but accepted", "negatives accepted", "best place right"]
    assert rows["howard"][0] == "1/1"
    assert rows["howard"][3:5] == ["0", "0 of 1"]
    assert len(rows["trehard"]) == 8


def test_the_comparison_counts_what_each_method_got_right():
    right, wrong, refused = (result(50, 0.0, *rest) for rest in ((True, True), (False, True), (True, False)))
    rows = comparison({"one": [right, wrong], "two": [refused, result(None, 0.0, False, True)]}).rows
    assert rows[0] == ["one", "1/2", "1/2", "1", "0 of 0", "1", "0.30", "0.30"]
    assert rows[1] == ["two", "0/1", "0/1", "0", "1 of 1", "1", "0.30", "0.30"]


def test_every_overlap_has_a_column():
    columns, rows = comparison({"one": [result(60, 0.0, True, True)], "two": [result(100, 0.0, False, True)]})
    assert columns[:4] == ["method", "100 %", "60 %", "all"]
    assert [row[1:4] for row in rows] == [["-", "1/1", "1/1"], ["0/1", "-", "0/1"]]


def test_methods_that_do_not_exist_are_wrong_usage(folder, usage_error):
    assert "--method: there is no 'guess'; there are correlation, features, birk-carpin" in usage_error(
        benchmark.main, ["align", str(folder), "--method", "trehard,guess"]
    )


def test_a_folder_without_pairs_is_an_error(tmp_path, capsys):
    assert benchmark.main(["align", str(tmp_path)]) == 1
    assert "holds no .npz pair of maps: give the folder that does" in capsys.readouterr().err


def test_another_file_is_no_pair(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(PairFileError, match="is not a pair of maps"):
        load_pair(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"T_ab": np.full((3, 3), np.nan)}, "T_ab is no finite matrix"),
        ({"T_ab": np.eye(2)}, "T_ab is no finite matrix"),
        ({"occ_a": np.full((5, 5), 120, np.int8)}, "occupancy must be from -1 to 100, got 120 to 120"),
        ({"resolution": np.array(np.nan)}, "resolution must be positive"),
        ({"occ_b": np.zeros((0, 5), np.int8)}, r"got int8 of shape \(0, 5\)"),
    ],
)
def test_a_pair_that_cannot_be_is_refused(folder, tmp_path, changes, said):
    with np.load(next(folder.glob("*_050.npz"))) as arrays:
        np.savez(tmp_path / "pair.npz", **(dict(arrays) | changes))
    with pytest.raises(TbmSlamError, match=said):
        load_pair(tmp_path / "pair.npz")


def test_a_pipe_is_no_pair(tmp_path):
    os.mkfifo(tmp_path / "pair.npz")
    with pytest.raises(PairFileError, match="is a device or a pipe: give a folder of pairs"):
        load_pair(tmp_path / "pair.npz")


def test_right_is_within_half_a_metre_and_two_degrees(folder):
    pair = load_pair(next(folder.glob("*_050.npz")))
    true = pair.T_target_source
    assert pair.is_right(true)
    assert not pair.is_right(SE2(true.x + 0.6, true.y, true.theta))
    assert not pair.is_right(SE2(true.x, true.y, true.theta + 0.05))
    assert not pair.is_right(None)


def test_near_is_the_true_place_a_little_turned(folder):
    pair = load_pair(next(folder.glob("*_050.npz")))
    true = pair.T_target_source
    rows, cols = np.nonzero(pair.source.grid.is_known())
    middle = pair.source.grid.geometry.centre_of(rows.mean(), cols.mean())
    x, y = true.apply(middle)
    about_it = [SE2(x, y, 0.0) @ SE2(0.0, 0.0, turn) @ SE2(-x, -y, 0.0) @ true for turn in (0.05, 0.1)]
    assert [pair.is_right(motion) for motion in about_it] == [False, False]
    assert [pair.is_near(motion) for motion in about_it] == [True, False]
    assert not load_pair(next(folder.glob("neg*"))).is_near(true)


def test_the_model_is_fitted_and_written(folder, tmp_path, capsys):
    other = tmp_path / "other"
    store = ["--world", "store", "--seeds", "1", "--area", "50", "--overlap", "100", "50"]
    assert make_map_pairs.main(["-o", str(other), *store]) == 0
    model, again = tmp_path / "model.json", tmp_path / "again.json"
    what = [str(folder), "--simulated", str(other), "--bent", str(other), "--strangers", "1"]
    capsys.readouterr()
    assert calibrate_merging.main([*what, "-o", str(model)]) == 0
    printed = capsys.readouterr().out
    assert calibrate_merging.main([*what, "-o", str(again), "--workers", "1"]) == 0
    assert again.read_text() == model.read_text()
    assert capsys.readouterr().out == printed
    for name in (folder, other, f"{other}, bent", "strangers"):
        assert f"{name}, by models fitted without its buildings" in printed
    assert "all pairs, by models fitted without their buildings" in printed
    written = json.loads(model.read_text())
    assert set(written["weights"]) == set(FEATURES)
    assert written["weights"]["log of all walls"] <= 0.0 <= written["weights"]["agreement"]
    assert set(written["score"]) == set(MEASURES)


def test_large_pairs_are_not_written(tmp_path, capsys):
    kind = ["--world", "store", "--area", "40", "--overlap", "50"]
    assert make_map_pairs.main(["-o", str(tmp_path), *kind, "--largest", "1"]) == 0
    assert capsys.readouterr().out.startswith("0 pairs")


def test_pairs_are_cut_from_floors_of_like_blocks(tmp_path):
    out = ["-o", str(tmp_path), "--lattice", "400", "--seeds", "3", "4", "--overlap", "50"]
    assert make_map_pairs.main(out) == 0
    names = {path.stem.split("_")[0] + "_" + path.stem.split("_")[1] for path in tmp_path.iterdir()}
    assert {"crop_lattice3", "crop_lattice4", "negs_lattice3", "negd_lattice3"} <= names


def test_pairs_are_cut_from_a_real_floor(folder, tmp_path, capsys):
    whole = next(folder.glob("*_100.npz"))
    out = tmp_path / "cut"
    assert make_map_pairs.main(["-o", str(out), "--floor", f"flat={whole}", "--overlap", "50", "--parts", "1"]) == 0
    names = sorted(path.stem for path in out.iterdir())
    assert [name for name in names if name.startswith("crop")] == [
        "crop_flat_1_050", "crop_flatmir_2_050", "crop_flatpart1mir_3_050",
    ]  # fmt: skip
    assert not [name for name in names if name.startswith("negd_flatmir_flatpart1mir")]
    assert load_pair(out / "crop_flatmir_2_050.npz").T_target_source is not None


def test_a_floor_needs_a_name(capsys):
    with pytest.raises(SystemExit):
        make_map_pairs.main(["-o", "x", "--floor", "pair.npz"])
    assert (
        "--floor must be NAME=PATH with a name of letters, digits, dots and dashes, got pair.npz"
        in capsys.readouterr().err
    )


def test_a_floor_that_is_not_there_is_an_error(tmp_path, capsys):
    assert make_map_pairs.main(["-o", str(tmp_path), "--floor", f"flat={tmp_path / 'no.npz'}"]) == 1
    assert "no.npz" in capsys.readouterr().err


def test_the_fit_needs_a_process(capsys):
    with pytest.raises(SystemExit):
        calibrate_merging.main(["x", "--workers", "0"])
    assert "--workers: must be a whole number of at least 1, got '0'" in capsys.readouterr().err


def test_nothing_to_fit_on_is_an_error(tmp_path, capsys):
    assert calibrate_merging.main([str(tmp_path)]) == 1
    assert "no .npz pair of maps there" in capsys.readouterr().err


TRUE = SE2(1.0, 0.5, 0.4)


def room(free):
    masses = np.tile(np.array([0.0, 0.0, 0.0, 1.0], dtype=np.float32), (60, 60, 1))
    masses[free] = (0.0, 0.9, 0.0, 0.1)
    return TbmMap(TbmGrid(GridGeometry(0.1, 0.0, 0.0, 60, 60), masses))


def test_robots_meet_where_both_know_free_space_and_measure_with_noise():
    pair = KnownPair("room", room(np.s_[10:50, 10:50]), room(np.s_[10:50, 10:50]), TRUE, 0.9)
    (met,) = encounters_of(pair)
    assert encounters_of(pair) == [met]
    assert math.hypot(met.T_robot_other.x, met.T_robot_other.y) < 3.0 + 0.3
    for pose in (met.T_target_robot, met.T_source_other):
        assert 1.0 < pose.x < 5.0
        assert 1.0 < pose.y < 5.0
    found = howard.align([met]).T_target_source
    assert 0.0 < math.dist(found[:2], TRUE[:2]) < 0.5
    assert found.theta == pytest.approx(TRUE.theta, abs=math.radians(4.0))


def test_robots_do_not_meet_in_different_places():
    free = room(np.s_[10:50, 10:50])
    assert encounters_of(KnownPair("foreign", free, free, None, 0.0)) == []
    assert encounters_of(KnownPair("apart", free, free, SE2(20.0, 0.0, 0.0), 0.0)) == []
