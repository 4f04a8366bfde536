"""Perturbed runs: their order, and the others where one fails."""

import os
import shutil

import numpy as np
import pytest

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Call, Executor
from tbmslam.parallel.worker_pool import WorkerDiedError
from tools.benchmark import main, parser
from tools.benchmarks.perturb import UNPERTURBED, Perturbation, benchmark_perturbations, errors_of
from tools.benchmarks.recordings import DriveErrors, SimulatedRecording


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    world = "office:1:good,beams=91,rate=5,duration=10"
    return SimulatedRecording.parse(world).write(tmp_path_factory.mktemp("drive"))


def die(_):
    os._exit(9)


def test_a_run_whose_process_dies_does_not_stop_the_others(spec):
    changed = [UNPERTURBED, Perturbation("deadly", change=die), Perturbation("the same")]
    calls = [Call(one.name, errors_of, (spec, one)) for one in changed]
    before, dead, after = Executor(2).outcomes(calls)
    assert isinstance(dead, WorkerDiedError)
    assert isinstance(before, DriveErrors)
    assert isinstance(after, DriveErrors)


def run_out_of_memory(_):
    raise MemoryError


def test_a_run_that_runs_out_of_memory_does_not_stop_the_others(spec):
    changed = [Perturbation("large", change=run_out_of_memory), UNPERTURBED]
    large, after = Executor().outcomes([Call(one.name, errors_of, (spec, one)) for one in changed])
    assert isinstance(large, TbmSlamError)
    assert str(large) == "memory has run out"
    assert isinstance(after, DriveErrors)


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
