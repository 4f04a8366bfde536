import io
import sys
from pathlib import Path

import pytest

from tools.command_line.grammar import Grammar

TOOLS = Path(__file__).resolve().parents[3] / "tools"


class FullDisk(io.StringIO):
    def flush(self):
        raise OSError(28, "No space left on device")


def test_help_that_cannot_be_printed_is_one_line(monkeypatch, capsys):
    grammar = Grammar(prog="merge")
    below = grammar.add_subparsers().add_parser("maps")
    monkeypatch.setattr(sys, "stdout", FullDisk())
    for one in (grammar, below):
        with pytest.raises(SystemExit) as ended:
            one.parse_args(["--help"])
        assert ended.value.code == 1
        assert capsys.readouterr().err == "merge: No space left on device: check what is read and printed\n"


def test_help_is_printed_where_it_can(monkeypatch, capsys):
    with pytest.raises(SystemExit) as ended:
        Grammar(prog="merge").parse_args(["--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: merge")
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(SystemExit) as ended:
        Grammar(prog="merge").parse_args(["--help"])
    assert ended.value.code == 0
    file = io.StringIO()
    Grammar(prog="merge").print_help(file)
    assert file.getvalue().startswith("usage: merge")


def test_every_program_has_such_a_grammar():
    sources = [path.read_text(encoding="utf-8") for path in TOOLS.glob("*.py")]
    programs = [source for source in sources if "def main(" in source]
    assert len(programs) > 5
    assert not any("argparse.ArgumentParser(" in source for source in programs)


def test_numbers_with_an_exponent_are_no_options():
    parser = Grammar()
    parser.add_argument("--pose", nargs=2, type=float)
    assert parser.parse_args(["--pose", "-1e-05", "-2.5E+1"]).pose == [-1e-05, -25.0]
