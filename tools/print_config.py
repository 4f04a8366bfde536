"""Print all parameters with meaning, unit and value as TOML for --config."""

import argparse
import sys
from collections.abc import Sequence

from tools.command_line.options import add_configuration_options
from tools.command_line.paths import check_exist
from tools.command_line.program import ProgramParser, run_program

EXAMPLES = """examples:
  tbmslam config > mine.toml
      the defaults, to be edited and given to `tbmslam map` or `merge` with --config mine.toml
  tbmslam config --config out/robot_0
      the parameters of an earlier result
"""


def parser(program: str = "print_config") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    add_configuration_options(grammar, "map.resolution=0.1", printing=False)
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def main(arguments: Sequence[str] | None = None, program: str = "print_config") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    args = parser(program).parse_args(arguments)
    return run_program(program, lambda: _run(args), debug=args.debug)


def _run(args: argparse.Namespace) -> None:
    check_exist([args.config])
    from tools.command_line.configuration import read_configuration, whole_text

    print(whole_text(read_configuration(args.preset, args.config).with_settings(args.set)), end="")


if __name__ == "__main__":
    sys.exit(main())
