import argparse
import importlib
import re
from pathlib import Path

import pytest

from tbmslam import commands
from tests.processes import python
from tools import build_maps, merge

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = (
    *("build_maps", "merge", "make_world", "evaluate", "benchmark"),
    *("download", "print_config", "completion", "warm_up"),
)
COMMANDS = {program: command for command, (program, _) in commands.PROGRAMS.items()}


def parsers(program):
    """Return a program's grammar and those of its commands."""
    module = importlib.import_module(f"tools.{program}")
    grammar = module.parser()
    below = [action for action in grammar._actions if isinstance(action, argparse._SubParsersAction)]
    return [grammar, *(one for action in below for one in action.choices.values())]


@pytest.mark.parametrize("program", PROGRAMS)
def test_each_help_has_two_examples_and_the_exit_codes(program):
    for grammar in parsers(program):
        text = grammar.format_help()
        assert len(re.findall(rf"\n  tbmslam {COMMANDS[program]}[ \n]", text)) >= 2
        assert "exit codes: 0 " in text


@pytest.mark.parametrize("program", PROGRAMS)
def test_examples_hold_no_percent_sign(program):
    # argparse turns two percent signs into one only where a text names %(prog)s.
    for grammar in parsers(program):
        assert "%" not in (grammar.epilog or "")


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_option_is_explained(program):
    for grammar in parsers(program):
        for action in grammar._actions:
            assert action.help or isinstance(action, argparse._SubParsersAction), action


@pytest.mark.parametrize("program", [*PROGRAMS, "convert", "edit", "figures", "reproduce_paper"])
def test_help_loads_nothing_heavy(program):
    heavy = "{'numpy', 'numba', 'scipy', 'cv2', 'pydantic', 'rosbags'}"
    help_ = f"from tools.{program} import parser; parser().format_help()"
    done = python("-c", f"import sys; {help_}; print({heavy} & set(sys.modules))")
    assert (done.stdout, done.stderr) == ("set()\n", "")


def test_an_interrupted_run_states_how_to_continue(monkeypatch, capsys, tmp_path):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.mapping.run.plan_mapping", stop)
    (tmp_path / "x.bag").touch()
    assert build_maps.main([str(tmp_path / "x.bag"), "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == (
        "build_maps: interrupted: run the same command again to continue; finished robots are kept\n"
    )


@pytest.mark.parametrize(
    ("program", "step", "line"),
    [
        (build_maps, "tools.mapping.run.plan_mapping", "build_maps: memory has run out: use a coarser map.resolution"),
        (merge, "tbmslam.io.map_folder.load_map", "merge: memory has run out: merge fewer maps"),
    ],
)
def test_memory_that_runs_out_is_one_line(monkeypatch, capsys, tmp_path, program, step, line):
    def fill(*_):
        raise MemoryError

    monkeypatch.setattr(step, fill)
    given = [tmp_path / "x.bag", tmp_path / "y.bag"]
    for path in given:
        path.touch()
    words = [*map(str, given), "-o", str(tmp_path / "out")]
    assert program.main(words) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(line)
    with pytest.raises(MemoryError):
        program.main([*words, "--debug"])


def test_the_page_of_options_states_the_command_that_messages_name_where_no_clone_is():
    assert "wheel, it is `pip install 'tbmslam[viewer]'`" in (ROOT / "docs" / "options.md").read_text("utf-8")
