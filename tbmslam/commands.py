"""The command `tbmslam`, which runs all programs."""

import importlib
import sys
from collections.abc import Sequence

from tools.command_line.interruption import handle_interruption

PROGRAMS = {
    "map": ("build_maps", "turn recordings into one belief map per robot"),
    "merge": ("merge", "merge maps with unknown relative poses"),
    "evaluate": ("evaluate", "compare trajectories and maps with the truth"),
    "convert": ("convert", "convert a map from one format to another"),
    "edit": ("edit", "crop, turn, erase and draw by hand"),
    "download": ("download", "download public recordings by name"),
    "world": ("make_world", "simulate robots in a building, and write their bags"),
    "benchmark": ("benchmark", "measure speed, memory and errors"),
    "config": ("print_config", "print all parameters as TOML"),
    "warm-up": ("warm_up", "compile everything now, so that the first map does not wait"),
    "completion": ("completion", "print the script that completes these commands in a shell"),
}
"""The module of `tools` and the description of each command."""

USAGE = """usage: tbmslam [--help] [--version] COMMAND ...

Turn laser recordings of several robots into one 2D map.

commands:
{commands}

`tbmslam COMMAND --help` lists the options of a command, with examples.
"""
WRONG_USAGE = 2


def run() -> int:
    """Run the command of this process, and return its exit code."""
    words = sys.argv[1:]
    handle_interruption(f"tbmslam {words[0]}" if words and words[0] in PROGRAMS else "tbmslam")
    return main(words)


def main(words: Sequence[str]) -> int:
    """Run a command and return its exit code."""
    command = words[0] if words else ""
    if command in PROGRAMS:
        program = importlib.import_module(f"{_TOOLS}.{PROGRAMS[command][0]}")
        return int(program.main(list(words[1:]), f"tbmslam {command}"))
    if command in ("-h", "--help"):
        sys.stdout.write(usage())
        return 0
    if command == "--version":
        sys.stdout.write(f"tbmslam {version()}\n")
        return 0
    what = f"there is no command {command!r}" if command else "a command is missing"
    sys.stderr.write(f"tbmslam: error: {what}; there are {', '.join(PROGRAMS)} (tbmslam --help describes them)\n")
    return WRONG_USAGE


def usage() -> str:
    """Return the text of `--help`."""
    width = max(map(len, PROGRAMS))
    return USAGE.format(commands="\n".join(f"  {name:{width}}  {about}" for name, (_, about) in PROGRAMS.items()))


def version() -> str:
    """Return the installed version."""
    from importlib import metadata  # noqa: PLC0415 - it takes longer to load than all else

    try:
        return metadata.version("tbmslam")
    except metadata.PackageNotFoundError:
        return "of a source tree that is not installed"


_TOOLS = handle_interruption.__module__.rpartition(".command_line")[0]
"""The package of the programs, which has another name in a wheel."""
