"""Perturbed runs: their order, and the others where one fails."""

import io
import json
import os
import re
import shutil
from contextlib import redirect_stderr, redirect_stdout

import numpy as np
import pytest

from tbmslam.errors import TbmSlamError
from tools.benchmark import main, parser
from tools.benchmarks.perturb import UNPERTURBED, Perturbation, benchmark_perturbations, perturbations
from tools.benchmarks.recordings import DriveErrors, SimulatedRecording

# One worker runs the perturbations for all of them.
pytestmark = pytest.mark.xdist_group("perturbations")


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    world = "office:1:good,beams=91,rate=5,duration=40"
    return SimulatedRecording.parse(world).write(tmp_path_factory.mktemp("drive"))


def die(_):
    os._exit(9)


def run_out_of_memory(_):
    raise MemoryError


SETTING = "deskew.enabled=false"
LATER, DROPPED = "begun 30 s later", "5 % of scans dropped"
FAILING = [Perturbation("broken", change=len), Perturbation("deadly", change=die)]
LARGE = Perturbation("large", change=run_out_of_memory)


def perturbed(spec, folder, *words, patches):
    """Run perturbations; return the printed lines, the messages, the cells of each row and the record."""
    file, out, err = folder / "figures.json", io.StringIO(), io.StringIO()
    words = ["perturb", str(spec.path), *words, "--json", str(file), "--table", str(folder / "tables.json")]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        for name, stand_in in patches.items():
            patch.setattr(f"tools.benchmarks.perturb.{name}", stand_in)
        assert main(words) == 0
    *lines, machine = out.getvalue().splitlines()
    assert machine.startswith("processor ")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")]
    cells = {row[0]: row[1:] for row in rows[2:]}
    (record,) = json.loads(file.read_text())["recordings"]
    return lines, err.getvalue(), cells, record["scores"]


@pytest.fixture(scope="module")
def beside(spec, tmp_path_factory):
    """Runs of which two fail, two at a time, each in a process of its own."""

    def few(settings):
        found = {one.name: one for one in perturbations(settings)}
        return [UNPERTURBED, *FAILING, found[LATER]]

    return perturbed(spec, tmp_path_factory.mktemp("beside"), "--jobs", "2", patches={"perturbations": few})


@pytest.fixture(scope="module")
def alone(spec, tmp_path_factory):
    """Runs one after the other, in this process, whose memory runs out in the second."""

    def few(settings):  # the others are tried one by one in test_perturb.py
        chosen = [one for one in perturbations(settings) if one.name in (LATER, DROPPED, SETTING)]
        return [UNPERTURBED, LARGE, *chosen]

    patches = {"perturbations": few, "in_fresh_process": lambda run, *arguments: run(*arguments)}
    folder = tmp_path_factory.mktemp("alone")
    return folder, *perturbed(spec, folder, "--jobs", "1", "--without", SETTING, patches=patches)


def test_a_simulated_drive(alone):
    folder, lines, err, cells, scores = alone
    assert len(cells) == 5
    assert float(cells["as it is"][0]) < 0.02
    assert cells["as it is"][1:] == ["-", "0", "0", "1.00", "-"]
    assert cells[SETTING][-1] == "ok"
    assert int(cells[LATER][3]) == 150
    assert 0 < int(cells[DROPPED][3]) < 30
    assert "4 perturbed runs, " in lines[-1]
    assert "benchmark: 5/5 robot_0.bag" in err
    assert [one["perturbation"] for one in scores] == list(cells)
    assert scores[0]["verdict"] == "-"
    tables = json.loads((folder / "tables.json").read_text())["tables"]
    (row,) = tables["overview"]["rows"]
    assert row[:3] == ["robot_0", cells["as it is"][0], "4"]
    assert [row[0] for row in tables["robot_0"]["rows"]] == list(cells)


@pytest.mark.parametrize("name", ["as it is", LATER])
def test_runs_in_processes_of_their_own_have_the_errors_of_runs_here(beside, alone, name):
    (there,), (here,) = ([one for one in scores if one["perturbation"] == name] for *_, scores in (beside, alone))
    assert there == here
    assert beside[2][name] == alone[3][name]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("broken", r"TypeError: .+"),
        ("deadly", r"a worker process died, perhaps out of memory: .+"),
    ],
)
def test_a_run_that_fails_is_a_row_and_the_others_go_on(beside, name, why):
    lines, err, cells, _ = beside
    assert re.fullmatch(f"FAILED: {why}", cells[name][-1])
    assert (cells["as it is"][-1], cells[LATER][-1]) == ("-", "ok")
    assert "3 perturbed runs, 2 misses, 2 of them lost or failed" in lines[-1]
    assert "benchmark: 4/4 robot_0.bag" in err


def test_a_run_without_memory_is_a_row_and_the_others_go_on(alone):
    _, lines, _, cells, _ = alone
    assert cells["large"][-1] == "FAILED: memory has run out"
    assert cells[SETTING][-1] == "ok"
    assert lines[-1].endswith("1 of them lost or failed")


FEW = [UNPERTURBED, Perturbation("a little"), Perturbation("more")]


@pytest.fixture
def two(spec, tmp_path, monkeypatch):
    """Two recordings to which few perturbations are applied."""
    monkeypatch.setattr("tools.benchmarks.perturb.perturbations", lambda _: FEW)
    for name in ("first", "second"):
        for suffix in (".bag", ".truth.tum"):
            shutil.copy(spec.path.with_suffix(suffix), tmp_path / f"{name}{suffix}")
    return [str(tmp_path / "first.bag"), str(tmp_path / "second.bag")]


def test_unperturbed_recordings_come_first_and_a_failure_of_one_ends_all(two, monkeypatch, capsys):
    ran = []

    def failing(spec, perturbation):
        ran.append((spec.name, perturbation.name))
        if spec.name == "second":
            raise TbmSlamError("second.bag: too dark")
        return DriveErrors("poses", np.ones(1), np.ones(1), np.ones(1, dtype=np.bool_))

    monkeypatch.setattr("tools.benchmarks.perturb.errors_of", failing)
    assert main(["perturb", *two]) == 1
    assert ran == [("first", UNPERTURBED.name), ("second", UNPERTURBED.name)]
    assert capsys.readouterr().err.endswith("benchmark: second.bag: too dark\n")


def test_each_table_has_the_runs_of_its_recording_in_order(two, monkeypatch, capsys):
    def known(spec, perturbation):
        metres = (1.0 if spec.name == "first" else 2.0) + 0.01 * FEW.index(perturbation)
        return DriveErrors("relations", np.full(1, metres), np.ones(1), np.ones(1, dtype=np.bool_))

    monkeypatch.setattr("tools.benchmarks.perturb.errors_of", known)
    assert main(["perturb", *two]) == 0
    rows = [[cell.strip() for cell in line.split("|")] for line in capsys.readouterr().out.splitlines()]
    assert [(row[1], float(row[2])) for row in rows if row[1:2] and row[1] in {one.name for one in FEW}] == [
        *((one.name, 1.0 + 0.01 * index) for index, one in enumerate(FEW)),
        *((one.name, 2.0 + 0.01 * index) for index, one in enumerate(FEW)),
    ]


def test_ctrl_c_while_a_failure_stops_the_other_runs_is_not_lost(two, monkeypatch):
    """Python drops exceptions of a generator that is not closed explicitly."""

    def outcomes(*_):
        try:
            yield TbmSlamError("too dark")
        finally:
            raise KeyboardInterrupt

    monkeypatch.setattr("tools.benchmarks.perturb.Executor.outcomes", outcomes)
    with pytest.raises(KeyboardInterrupt):
        benchmark_perturbations(parser().parse_args(["perturb", *two]))
