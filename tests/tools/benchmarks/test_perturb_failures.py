"""Perturbed runs that fail, and the others that go on."""

import os

import pytest

from tbmslam.errors import TbmSlamError
from tbmslam.parallel.executor import Call, Executor
from tbmslam.parallel.worker_pool import WorkerDiedError
from tools.benchmarks.perturb import UNPERTURBED, Perturbation, errors_of
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
