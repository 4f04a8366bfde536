import gc
import os
import signal
import sys

import pytest

from tools.loading import loading


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


@pytest.fixture
def hears_ctrl_c():
    """As on a terminal; what a shell starts behind itself does not hear it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_ctrl_c")
def test_ctrl_c_while_modules_load_ends_the_program_with_its_line(monkeypatch, capsys):
    codes = []
    monkeypatch.setattr(os, "_exit", codes.append)
    with loading("merge: interrupted"):
        signal.raise_signal(signal.SIGINT)
    assert codes == [130]
    assert capsys.readouterr().err == "merge: interrupted\n"
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_whoever_hears_ctrl_c_otherwise_goes_on_to():
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    try:
        with loading("merge: interrupted"):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [True]
