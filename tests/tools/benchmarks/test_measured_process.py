import os

import pytest

from tbmslam.relations import read_relations
from tools.benchmarks.measured_process import MeasurementError, forget_peak_memory, in_fresh_process, peak_memory_mb


def test_a_call_is_made_in_another_process():
    assert in_fresh_process(os.getpid) != os.getpid()


def test_memory_is_that_of_the_process_alone():
    held = bytearray(200_000_000)
    held[::4096] = b"x" * len(held[::4096])
    here = peak_memory_mb()
    assert here > 200.0
    assert in_fresh_process(peak_memory_mb) < here - 150.0


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="needs a system that forgets its peak")
def test_a_peak_can_be_forgotten():
    held = bytearray(200_000_000)
    held[::4096] = b"x" * len(held[::4096])
    before = peak_memory_mb()
    del held
    forget_peak_memory()
    assert peak_memory_mb() < before - 150.0


def test_a_known_error_keeps_its_line(tmp_path):
    with pytest.raises(MeasurementError, match=r"none\.relations: cannot be read as relations"):
        in_fresh_process(read_relations, tmp_path / "none.relations")


def test_a_process_that_dies_is_told():
    with pytest.raises(MeasurementError, match=r"the process died \(exit code 9\): memory may have run out"):
        in_fresh_process(os._exit, 9)
