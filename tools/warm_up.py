"""Compile all functions of mapping and merging, so that later runs start at once."""

import argparse
import contextlib
import io
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tools.command_line.program import DONE, ProgramParser, run_program

EXAMPLES = """examples:
  tbmslam warm-up
      a minute or two on a new machine, seconds where all is compiled
  tbmslam warm-up --debug
      with a traceback, should something fail
"""
_DRIVE_M = "30"


def parser(program: str = "warm_up") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def main(arguments: Sequence[str] | None = None, program: str = "warm_up") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    args = parser(program).parse_args(arguments)
    return run_program(
        program,
        _run,
        debug=args.debug,
        interrupted="compiled functions are kept; run the same command again to continue",
    )


def _run() -> int:
    from tools.command_line.progress import announce_compiling

    begin = time.perf_counter()
    compiling = announce_compiling()
    known = compiling.count
    with tempfile.TemporaryDirectory() as folder:
        code = _map_and_merge(Path(folder))
    if code == DONE:
        print(f"{compiling.count - known} functions compiled in {time.perf_counter() - begin:.0f} s")
    return code


def _map_and_merge(folder: Path) -> int:
    """Map two small simulated drives and merge the maps; return the exit code of the first program that fails."""
    from tools import build_maps, make_world, merge

    bags, maps, merged = (str(folder / name) for name in ("bags", "maps", "merged"))
    drive = f"--world apartment --robots 2 --length {_DRIVE_M} --overlap 0.6 --beams 181 --rate 5".split()
    with contextlib.redirect_stdout(io.StringIO()):
        return (
            make_world.main([*drive, "-o", bags])
            or build_maps.main([bags, "--separate", "--no-truth", "-o", maps])
            or merge.main([maps, "-o", merged])
        )


if __name__ == "__main__":
    sys.exit(main())
