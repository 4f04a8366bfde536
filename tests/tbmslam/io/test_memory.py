import os
import sys

import pytest

from tbmslam.io import map_check, memory
from tbmslam.io.map_check import MapFileError, check_size


def test_a_machine_has_memory_and_not_endlessly_much():
    assert 1e8 < memory.machine_memory() < 1e15


def test_a_container_may_have_less(tmp_path, monkeypatch):
    for name, text in (("max", "max\n"), ("small", "12345678\n")):
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(memory, "_CONTAINER_LIMITS", [str(tmp_path / name) for name in ("max", "none", "small")])
    assert memory.machine_memory.__wrapped__() == 12345678


def test_what_nobody_knows_is_no_limit(monkeypatch):
    monkeypatch.setattr(memory, "_CONTAINER_LIMITS", ("/none",) * 2)
    monkeypatch.delattr(os, "sysconf")
    assert memory.machine_memory.__wrapped__() == sys.maxsize


def test_a_map_too_large_for_the_machine_is_refused(monkeypatch):
    monkeypatch.setattr(map_check, "machine_memory", lambda: 1_900_000_000)
    check_size("m.yaml", 9000, 10000)
    with pytest.raises(
        MapFileError, match=r"^m\.yaml: 10000 x 10000 cells take 2\.0 GB of memory, and there are 1\.9: "
    ):
        check_size("m.yaml", 10000, 10000)
