"""Print a script that completes the commands and options of `tbmslam` in a shell."""

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program

SHELLS = ("bash", "zsh", "tcsh")
EXAMPLES = """examples:
  tbmslam completion bash > ~/.local/share/bash-completion/completions/tbmslam
      for every bash that is started from now on
  tbmslam completion zsh > ~/.zfunc/_tbmslam
      for zsh, if ~/.zfunc is in its fpath

exit codes: 0 done, 2 wrong usage, 130 interrupted, 143 terminated
"""


def parser(program: str = "completion") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("shell", choices=SHELLS, help="the shell")
    return grammar


def main(arguments: Sequence[str] | None = None, program: str = "completion") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    args = parser(program).parse_args(arguments)
    return run_program(program, lambda: _run(args))


def _run(args: argparse.Namespace) -> None:
    import shtab

    print(shtab.complete(_all_commands(), args.shell))


def _all_commands() -> argparse.ArgumentParser:
    """Return the grammar of `tbmslam` with those of all its commands."""
    from shtab import FILE

    from tbmslam.commands import PROGRAMS

    grammar = ProgramParser(prog="tbmslam")
    grammar.add_argument("--version", action="store_true", help="print the version")
    commands = grammar.add_subparsers(metavar="COMMAND")
    for name, (module, about) in PROGRAMS.items():
        commands.add_parser(name, help=about)
        program = importlib.import_module(f"{__name__.rpartition('.')[0]}.{module}")
        commands.choices[name] = program.parser(f"tbmslam {name}")
    for action in _actions(grammar):
        if action.type is path_argument:
            action.complete = FILE  # shtab reads it
    return grammar


def _actions(grammar: argparse.ArgumentParser) -> Iterator[Any]:
    """Yield the arguments of a grammar and of those below it."""
    for action in grammar._actions:  # noqa: SLF001 - shtab reads them too
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for below in action.choices.values():
                yield from _actions(below)


if __name__ == "__main__":
    sys.exit(main())
