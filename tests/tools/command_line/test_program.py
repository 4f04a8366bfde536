import gc
import io
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.io.map_folder import save_map
from tbmslam.map.tbm_map import TbmMap
from tests.processes import ROOT, python
from tools import evaluate, merge
from tools.command_line.interruption import Interruption
from tools.command_line.program import (
    ProgramParser,
    check_environment,
    escape_output,
    loading,
    one_line,
    run_program,
    typed_command,
)

PROGRAMS = {"build_maps": ("nowhere.bag", "-o"), "merge": ("nowhere", "nobody", "-o"), "make_world": ("-o",)}


def said_by(program, out, limit=None, **settings):
    """Return exit code and stderr of a program under a limit on its memory [MB] and settings of the environment."""

    def limited():
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit * 10**6, resource.RLIM_INFINITY))

    command = [sys.executable, str(ROOT / "tools" / f"{program}.py"), *PROGRAMS[program], str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **settings}
    run = subprocess.run(  # noqa: S603 - the programs of this repository
        command, env=environment, preexec_fn=limited, capture_output=True, check=False, text=True, timeout=60
    )
    return run.returncode, run.stderr


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("limit", [400, 700, 1250, 1900])
def test_too_little_memory_is_one_line(program, limit, tmp_path):
    code, said = said_by(program, tmp_path, limit)
    assert code == 1
    assert said.startswith(f"{program}: memory is limited to {limit} MB (ulimit -v), and compiled code takes")
    assert said.endswith("raise the limit to 2000000 kB or more\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("threads", ["abc", "0", "-2", "1.5", "\u0663"])
def test_a_number_of_threads_that_is_none_is_one_line(threads, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    with pytest.raises(TbmSlamError, match="not a number of threads: set it to 1 or more"):
        check_environment()
    if threads == "abc":
        code, said = said_by("merge", tmp_path)
        assert (code, said.count("\n")) == (1, 1)


def test_the_usual_environment_is_fit(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    check_environment()
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    check_environment()


def raising(error):
    def work():
        raise error

    return work


def test_what_a_program_returns_is_its_exit_code(capsys):
    assert [run_program("merge", lambda: 3), run_program("merge", lambda: None)] == [3, 0]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (TbmSlamError("x.bag: is empty"), "merge: x.bag: is empty"),
        (OSError(36, "File name too long", "x"), "merge: x: File name too long: check the name, or choose another"),
        (MemoryError(), "merge: memory has run out: merge fewer maps"),
    ],
)
def test_a_known_error_is_one_line_and_with_debug_an_error(capsys, error, line):
    assert run_program("merge", raising(error), out_of_memory="merge fewer maps") == 1
    assert capsys.readouterr().err == f"{line}\n"
    with pytest.raises(type(error)):
        run_program("merge", raising(error), debug=True)


def test_with_debug_the_systems_error_of_something_else_is_shown_as_well():
    with pytest.raises(BrokenPipeError):
        run_program("merge", raising(BrokenPipeError()), debug=True)


def test_a_mistake_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run_program("merge", raising(ZeroDivisionError()))


def printed_into(place, *words):
    """Run merge with its output going to a place; return its exit code and what it said."""
    command = [sys.executable, str(ROOT / "tools/merge.py"), *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(  # noqa: S603 - a fixed command
        command, stdout=place, stderr=subprocess.PIPE, text=True, env=environment, check=False
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
@pytest.mark.parametrize("words", [["--print-config"], ["--print-config", "--debug"], ["--help"]], ids=" ".join)
def test_a_full_disk_for_what_is_printed_is_one_line(words):
    with Path("/dev/full").open("w") as full:
        done = printed_into(full, *words)
    said = "merge: No space left on device: check the input and the output\n"
    assert (done.returncode, done.stderr) == (1, said)


@pytest.mark.parametrize("words", [["--print-config"], ["--print-config", "--debug"], ["--help"]], ids=" ".join)
def test_a_reader_that_has_read_enough_is_no_error_worth_a_line(words):
    reader, writer = os.pipe()
    os.close(reader)  # as `head` does
    done = printed_into(writer, *words)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_who_has_neither_output_nor_errors_gets_the_exit_code():
    closing = "import os, sys; os.close(1); os.close(2); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", closing, str(ROOT / "tools/merge.py")]
    for more, code in ((["--print-config"], 0), (["a.npz", "b.npz", "-o", "merged"], 1)):
        assert subprocess.run([*words, *more], env=environment, check=False).returncode == code  # noqa: S603


def test_a_name_that_is_no_text_can_be_printed(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", stream)
    escape_output()
    stream.write("drive \udcff\n")  # without a flush
    assert stream.buffer.getvalue() == b"drive \\udcff\n"


@pytest.mark.parametrize("configured", [True, False])
def test_a_message_cannot_steer_the_terminal(configured):
    code = f"""
import logging
from tools.command_line.program import run_program
if {configured}:
    logging.basicConfig(format="%(message)s")
run_program("merge", lambda: logging.getLogger("x").warning("%s: is odd", "laser\\x1b[2J\\nmerge: all is well"))
"""
    assert python("-c", code).stderr == "laser\\x1b[2J\\nmerge: all is well: is odd\n"


def test_maps_with_names_of_invalid_text_are_merged_and_saved(tmp_path):
    maps = [os.fsdecode(bytes(tmp_path / "r") + b"\xff%d" % number) for number in range(2)]
    for folder in maps:
        save_map(folder, TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 3, 4))))
    out = os.fsdecode(bytes(tmp_path / "merged") + b"\xff")
    done = printed_into(subprocess.PIPE, *maps, "-o", out)
    assert done.returncode == 3
    assert {"report.json", "report.html"} <= {path.name for path in Path(out).iterdir()}


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("a\nb"), "a b"),
        (ValueError("\x1b[2Ja"), "\\x1b[2Ja"),
        (OSError(36, "File name too long", "x\ny"), "x y: File name too long: check the name, or choose another"),
        (OSError("odd"), "odd: check the input and the output"),
    ],
)
def test_an_error_is_one_line(error, said):
    assert one_line(error) == said


def test_a_name_too_long_is_one_line(tmp_path, capsys):
    long, maps = str(tmp_path / ("x" * 300)), [tmp_path / "a", tmp_path / "b"]
    for folder in maps:
        save_map(folder, TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 3, 4))))
    assert merge.main([*map(str, maps), "-o", long]) == 1
    assert evaluate.main(["map", long, "--truth", long]) == 1
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in said] == ["merge", "evaluate"]
    assert "cannot be written into (File name too long): choose another folder with -o" in said[0]
    assert "File name too long: check the name, or choose another" in said[1]


def test_a_shell_command_is_reported_as_typed(monkeypatch):
    monkeypatch.setattr(sys, "orig_argv", ["python", "tools/merge.py", "a map", "-o", "out"])
    assert typed_command("merge", None) == "python tools/merge.py 'a map' -o out"


def test_a_call_from_python_is_reported_with_the_program_s_name():
    assert typed_command("merge", ["a", "b"]) == "merge a b"


class FullDisk(io.StringIO):
    def flush(self):
        raise OSError(28, "No space left on device")


def test_help_that_cannot_be_printed_is_one_line(monkeypatch, capsys):
    grammar = ProgramParser(prog="merge")
    below = grammar.add_subparsers().add_parser("maps")
    monkeypatch.setattr(sys, "stdout", FullDisk())
    for one in (grammar, below):
        with pytest.raises(SystemExit) as ended:
            one.parse_args(["--help"])
        assert ended.value.code == 1
        assert capsys.readouterr().err == "merge: No space left on device: check the input and the output\n"


def test_help_is_printed_where_it_can(monkeypatch, capsys):
    with pytest.raises(SystemExit) as ended:
        ProgramParser(prog="merge").parse_args(["--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: merge")
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(SystemExit) as ended:
        ProgramParser(prog="merge").parse_args(["--help"])
    assert ended.value.code == 0
    file = io.StringIO()
    ProgramParser(prog="merge").print_help(file)
    assert file.getvalue().startswith("usage: merge")


def test_every_program_has_such_a_grammar():
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "tools").glob("*.py")]
    programs = [source for source in sources if "def main(" in source]
    assert len(programs) > 5
    assert not any("argparse.ArgumentParser(" in source for source in programs)


def test_numbers_with_an_exponent_are_no_options():
    parser = ProgramParser()
    parser.add_argument("--pose", nargs=2, type=float)
    assert parser.parse_args(["--pose", "-1e-05", "-2.5E+1"]).pose == [-1e-05, -25.0]


def test_a_library_that_finds_no_memory_is_one_line(capsys):
    def work():
        raise ImportError("/lib/x.so: failed to map segment from shared object")

    assert run_program("merge", work, out_of_memory="merge fewer maps") == 1
    assert capsys.readouterr().err == "merge: memory has run out: merge fewer maps\n"
    with pytest.raises(ImportError, match="no module"):
        run_program("merge", lambda: (_ for _ in ()).throw(ImportError("no module named x")))


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


def test_a_program_collects_garbage_rarely():
    before, within = gc.get_threshold(), []
    assert run_program("merge", lambda: within.append(gc.get_threshold())) == 0
    assert within[0][0] > before[0]
    assert gc.get_threshold() == before


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
