import json
import math

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.trajectory_file import read_tum
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.tbm_map import TbmMap
from tools.benchmark import main
from tools.benchmarks.measured_process import MeasurementError
from tools.benchmarks.perturb import Score, poses_of, run_perturbed, score, summary
from tools.benchmarks.perturbations import UNPERTURBED, Perturbation, perturbations
from tools.benchmarks.recordings import DriveErrors, SimulatedRecording, parse_recording_spec


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    world = "office:2:good,beams=91,rate=5,duration=30"
    return SimulatedRecording.parse(world).write(tmp_path_factory.mktemp("drive"))


def test_a_laser_stated_elsewhere_is_scored_by_where_the_laser_was(spec):
    before = run_perturbed(spec, UNPERTURBED)
    assert before.kind == "poses"
    assert before.scored().all()
    for one in perturbations():
        if one.name.startswith("laser"):
            after = run_perturbed(spec, one)
            # Unless it were scored there, turns of the robot would leave centimetres.
            assert after.error_m(after.scored()) < before.error_m(before.scored()) + 0.005


def test_scans_taken_away_are_known(spec):
    dropped = next(one for one in perturbations() if "dropped" in one.name)
    errors = run_perturbed(spec, dropped)
    truth = read_tum(spec.path.with_suffix(".truth.tum"))
    assert len(errors.metres) == len(truth)
    np.testing.assert_array_equal(errors.scored(), errors.has_scans)
    assert 0 < (~errors.has_scans).sum() < 0.15 * len(truth)


def test_all_drives_of_a_map_are_scored():
    def drive(stamps):
        poses = np.column_stack((stamps, np.zeros(2), np.full(2, math.pi / 2)))
        return Drive("robot", Trajectory(np.array(stamps), poses), Keyframes.from_scans([], [], []))

    grid = TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 1, 1))
    moved = next(one for one in perturbations() if one.name == "laser +4 cm in x")
    poses = poses_of(TbmMap(grid, (drive([0.0, 1.0]), drive([7.0, 8.0]))), moved)
    assert poses.stamps.tolist() == [0.0, 1.0, 7.0, 8.0]
    np.testing.assert_allclose(poses.poses[:, 0], poses.stamps, atol=1e-12)
    np.testing.assert_allclose(poses.poses[:, 1], 0.04)  # the robot was ahead of where it is stated
    assert len(poses_of(TbmMap(grid), moved)) == 0


NAN = np.nan


def errors(metres, has_scans=None, kind="relations"):
    metres = np.array(metres, dtype=np.float64)
    has = np.ones(len(metres), dtype=np.bool_) if has_scans is None else np.array(has_scans, dtype=np.bool_)
    return DriveErrors(kind, metres, 10.0 * metres, has)


def scored(metres, before, ratio=1.1, **more):
    return score(Perturbation("a little", ratio=ratio), errors(metres, **more), errors(before))


@pytest.mark.parametrize(
    ("metres", "before", "verdict"),
    [
        ([0.10, 0.12], [0.1, 0.1], "ok"),
        ([0.10, 0.13], [0.1, 0.1], "MISS"),
        ([0.013, 0.013], [0.01, 0.01], "ok"),  # 3 mm more
        ([0.0131, 0.0131], [0.01, 0.01], "MISS"),
        ([0.003, 0.003], [0.0005, 0.0005], "ok"),  # six times, yet not 3 mm more
        ([0.6, 0.6], [0.1, 0.1], "LOST"),
        ([0.1, NAN], [0.1, 0.1], "LOST"),
        ([NAN, NAN], [0.1, 0.1], "LOST"),
        ([0.1, NAN], [0.1, NAN], "ok"),
        ([0.1, 0.1], [0.1, NAN], "ok"),
        ([0.1, 9.0], [0.1, NAN], "LOST"),  # what could not be scored before is torn now
    ],
)
def test_verdicts(metres, before, verdict):
    assert scored(metres, before).verdict == verdict


def test_a_perturbation_may_be_allowed_more():
    assert scored([0.14], [0.1]).verdict == "MISS"
    assert scored([0.14], [0.1], ratio=1.5).verdict == "ok"


def test_relations_of_scans_that_were_taken_away_do_not_count():
    found = scored([NAN, 0.1, NAN, 5.0], [7.0, 0.1, 0.1, 0.1], has_scans=[False, True, True, False])
    assert (found.left_out, found.unscored, found.verdict) == (2, 1, "LOST")
    assert found.error_m == pytest.approx(0.1)
    assert found.error_deg == pytest.approx(1.0)
    assert found.ratio == pytest.approx(1.0)


def test_true_poses_between_the_scans_do_not_count():
    before = errors([0.1, NAN, 0.1], [True, False, True], "poses")
    found = score(Perturbation("a little"), errors([0.1, NAN, 0.1], [True, False, True], "poses"), before)
    assert (found.unscored, found.left_out, found.verdict, found.error_deg) == (0, 0, "ok", None)
    relations = errors([0.1, NAN], [True, False])  # while relations without scans cannot be scored
    assert score(UNPERTURBED, relations, relations).unscored == 1


def test_the_unperturbed_run_has_no_verdict_and_a_failed_run_has_a_reason():
    base = errors([0.1, NAN])
    assert score(UNPERTURBED, base, base) == Score("as it is", pytest.approx(0.1), pytest.approx(1.0), 1, 0, 1.0, "-")
    failed = score(Perturbation("a little"), MeasurementError("no scan is left"), base)
    assert failed.verdict == "FAILED: no scan is left"
    rows = [score(UNPERTURBED, base, base), failed, scored([0.1], [0.1]), scored([0.3], [0.1]), scored([NAN], [0.1])]
    assert summary(rows) == "4 perturbed runs, 3 misses, 2 of them lost or failed"


FEW = ("begun 30 s later", "5 % of scans dropped", "deskew.enabled=false")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    world = "office:1:good,beams=91,rate=5,duration=40"
    return SimulatedRecording.parse(world).write(folder).path


def test_a_simulated_drive(recording, tmp_path, capfd, monkeypatch):
    def few(settings):  # the others are tried one by one in test_perturbations.py
        return [one for one in perturbations(settings) if one.name in ("as it is", *FEW)]

    monkeypatch.setattr("tools.benchmarks.perturb.perturbations", few)

    def printed(jobs):
        file = tmp_path / f"{jobs}.json"
        words = ["perturb", str(recording), "--jobs", jobs, "--without", "deskew.enabled=false", "--json", str(file)]
        assert main([*words, "--table", str(tmp_path / "tables.json")]) == 0
        out, err = capfd.readouterr()
        *lines, machine = out.splitlines()
        assert machine.startswith("processor ")
        return lines, err, json.loads(file.read_text())["recordings"]

    lines, err, record = printed("2")
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + 4
    cells = {line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[2:-1]] for line in table[2:]}
    assert float(cells["as it is"][0]) < 0.02
    assert cells["as it is"][1:] == ["-", "0", "0", "1.00", "-"]
    assert cells["deskew.enabled=false"][-1] == "ok"
    assert int(cells["begun 30 s later"][3]) == 150
    assert 0 < int(cells["5 % of scans dropped"][3]) < 30
    assert "3 perturbed runs, " in lines[-1]
    assert "benchmark: 4/4 robot_0.bag" in err
    scores = record[0]["scores"]
    assert [one["perturbation"] for one in scores] == list(cells)
    assert scores[0]["verdict"] == "-"
    tables = json.loads((tmp_path / "tables.json").read_text())["tables"]
    (row,) = tables["overview"]["rows"]
    assert row[:3] == ["robot_0", cells["as it is"][0], "3"]
    assert [row[0] for row in tables["robot_0"]["rows"]] == list(cells)
    again, _, same_record = printed("1")
    assert (again, same_record) == (lines, record)


def test_what_cannot_be_run_is_one_line_before_anything_runs(recording, tmp_path, capsys):
    assert main(["perturb", str(recording), "--without", "tracker.wlaking=1.0"]) == 1
    assert "--without: there is no parameter 'tracker.wlaking': did you mean" in capsys.readouterr().err
    bare = tmp_path / "bare.bag"
    bare.write_bytes(recording.read_bytes())
    assert main(["perturb", str(bare)]) == 1
    assert "bare.bag: has no .relations and no .truth.tum beside it" in capsys.readouterr().err
    (tmp_path / "bare.truth.tum").write_text("0 0 0 0 0 0 0 1\n")
    bare.unlink()
    assert main(["perturb", str(bare)]) == 1
    assert "bare.bag: no such file or directory" in capsys.readouterr().err
    assert parse_recording_spec(str(bare)).path == bare
