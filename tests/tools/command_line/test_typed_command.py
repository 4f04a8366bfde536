import sys

from tools.command_line.typed_command import typed_command


def test_what_was_typed_in_a_shell_is_told_as_it_was(monkeypatch):
    monkeypatch.setattr(sys, "orig_argv", ["python", "tools/merge.py", "a map", "-o", "out"])
    assert typed_command("merge", None) == "python tools/merge.py 'a map' -o out"


def test_a_call_from_python_is_told_by_the_program_s_name():
    assert typed_command("merge", ["a", "b"]) == "merge a b"
