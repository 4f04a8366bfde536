"""A fault to try on the real programs, what came of it, and the programs run in this process."""

import io
import json
import logging
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools import build_maps, make_world
from tools.mapping.plan import robot_names


@dataclass(frozen=True)
class Outcome:
    """What the program did about a fault, what was lost, and whether the result is right or one clear line."""

    happened: str
    lost: str
    survived: bool


@dataclass(frozen=True)
class FaultCase:
    """A fault: its name, a function that makes it in a folder and runs the programs, and whether it is quick."""

    name: str
    attempt: Callable[[Path], Outcome]
    quick: bool = False


def shortened(line: str) -> str:
    """Return a line, or as many of its first words as a table has room for."""
    return textwrap.shorten(line, 150, placeholder=" ...")


@dataclass(frozen=True)
class ProgramRun:
    """The exit code and the stderr of a program."""

    code: int
    stderr: str

    def is_one_line(self) -> bool:
        """Return whether it ended with its known error and one line about it, after warnings."""
        lines = self.stderr.strip().splitlines()
        return (
            self.code == 1 and bool(lines) and lines[-1].startswith("build_maps: ") and "Traceback" not in self.stderr
        )


def run_program(main: Callable[[list[str]], int], *arguments: object) -> ProgramRun:
    """Run a program's `main` with arguments; what it would not catch is code -1."""
    said = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(said), _logged_to(said):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as left:
            code = int(left.code or 0)
        except Exception as error:  # noqa: BLE001 - whatever leaks is what is looked for here
            said.write(f"leaked {error!r}\n")
            code = -1
    return ProgramRun(code, said.getvalue())


def simulated(folder: Path, *arguments: object) -> Path:
    """Let make_world write a robot's drive of a minute into a folder, and return its bag."""
    usual = ("--world", "office", "--seed", 3, "--duration", 60, "--beams", 361, "--rate", 10)
    done = run_program(make_world.main, *usual, *arguments, "-o", folder)
    if done.code:
        raise RuntimeError(f"make_world failed: {done.stderr}")
    bag = folder / "robot_0.bag"
    return bag if bag.exists() else folder / "robot_0"


def mapped(recording: Path, folder: Path, *arguments: object) -> tuple[ProgramRun, dict[str, Any]]:
    """Run build_maps on a recording; return how that ended, and run.json where there is one."""
    done = run_program(build_maps.main, recording, *arguments, "--frames", "odometry", "-o", folder)
    path = folder / robot_names([recording])[0] / "run.json"
    run: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return done, run


@contextmanager
def _logged_to(stream: io.StringIO) -> Iterator[None]:
    """Have warnings written where the program writes, as they are from a shell."""
    handler = logging.StreamHandler(stream)
    handler.setLevel(logging.WARNING)
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
