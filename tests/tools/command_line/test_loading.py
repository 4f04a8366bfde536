import gc
import signal
import sys

import pytest

from tools.command_line.interruption import Interruption
from tools.command_line.loading import loading


@pytest.fixture
def small_module(tmp_path, monkeypatch):
    (tmp_path / "loaded_for_a_test.py").write_text("THINGS = [[] for _ in range(1000)]\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield "loaded_for_a_test"
    sys.modules.pop("loaded_for_a_test", None)
    gc.unfreeze()


def test_what_is_loaded_is_never_searched_for_garbage(small_module):
    before = gc.get_freeze_count()
    with loading():
        assert not gc.isenabled()
        __import__(small_module)
    assert gc.isenabled()
    assert gc.get_freeze_count() >= before + 1000


def test_where_nothing_is_loaded_garbage_is_found_as_ever():
    before = gc.get_freeze_count()
    with loading():
        pass
    assert (gc.get_freeze_count(), gc.isenabled()) == (before, True)


def test_a_module_that_fails_leaves_all_as_it_was():
    with pytest.raises(ModuleNotFoundError), loading():
        __import__("there_is_no_such_module")
    assert gc.isenabled()


def test_an_interruption_meanwhile_ends_the_program_at_once(monkeypatch):
    interruption = Interruption("merge")
    before = signal.signal(signal.SIGINT, interruption)
    interruption.ends_at_once = False
    try:
        with loading():
            assert interruption.ends_at_once
        assert not interruption.ends_at_once
    finally:
        signal.signal(signal.SIGINT, before)
