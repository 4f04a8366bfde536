import os
import sys

from tbmslam import machine_memory


def test_a_machine_has_memory_and_not_endlessly_much():
    assert 1e8 < machine_memory.machine_memory() < 1e15


def test_a_container_may_have_less(tmp_path, monkeypatch):
    for name, text in (("max", "max\n"), ("small", "12345678\n")):
        (tmp_path / name).write_text(text)
    files = [str(tmp_path / name) for name in ("max", "none", "small")]
    monkeypatch.setattr(machine_memory, "_CONTAINER_LIMITS", files)
    assert machine_memory.machine_memory.__wrapped__() == 12345678


def test_an_unknown_limit_is_no_limit(monkeypatch):
    monkeypatch.setattr(machine_memory, "_CONTAINER_LIMITS", ("/none",) * 2)
    monkeypatch.delattr(os, "sysconf")
    assert machine_memory.machine_memory.__wrapped__() == sys.maxsize
