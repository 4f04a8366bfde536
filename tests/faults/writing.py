"""Faults while results are written: each file stays the old one or is the new one, and a rerun goes on."""

import os
import re
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from itertools import product
from pathlib import Path

from tests.faults.child_run import run_child
from tests.faults.fault_case import FaultCase, Outcome, ProgramRun, run_program, shortened
from tests.faults.waiting_child import Moment, State
from tests.faults.written_maps import WrittenMaps, contents
from tools import build_maps, merge

_INTERRUPTED = 128 + signal.SIGINT
_STATES: tuple[State, ...] = ("empty", "half", "whole", "named")
_FULL_AT = 10_000
"""Size at which the disk is full [B]: a picture of the maps is smaller, a map larger."""


def _stopped(
    folder: Path,
    send: signal.Signals,
    code: int,
    *,
    fact: str = "interrupted",
    files: Iterable[str] = ("map.npz",),
    states: Iterable[State] = _STATES,
    words: tuple[str, ...] = (),
) -> Outcome:
    """Send build_maps a signal at some moments of the writing of some files."""
    torn = []
    for number, (name, state) in enumerate(product(files, states)):
        maps = WrittenMaps(folder / str(number))
        moment = Moment(str(maps.out / "robot_1" / name), state, _signs(folder))
        done = run_child(build_maps, *maps.arguments(*words), at=moment, do=lambda group: os.killpg(group, send))
        said = _as_wanted(done, code, fact)
        if not (said and maps.are_whole() and maps.run_again()):
            torn.append(f"{name}, {state}" + ("" if said else f": exit {done.code}, {done.stderr[-60:]!r}"))
    happened = f"torn: {'; '.join(torn)}" if torn else "each file is whole, the old or the new; a rerun made the rest"
    return Outcome(happened, "everything" if torn else "nothing", survived=not torn)


def _merge_killed(folder: Path) -> Outcome:
    """Kill merge at each moment while it writes its map over an older one."""
    maps = WrittenMaps(folder / "maps")
    for name, rule in (("old", "disjunctive"), ("new", "conjunctive")):
        run_program(merge.main, maps.folder / "new", "--rule", rule, "-o", folder / name)
    old, new = contents(folder / "old"), contents(folder / "new")
    torn = []
    for state in _STATES:
        merged = shutil.copytree(folder / "old", folder / state)
        words = (maps.folder / "new", "--rule", "conjunctive", "-o", merged)
        moment = Moment(str(merged / "map.npz"), state, _signs(folder))
        run_child(merge, *words, at=moment, do=lambda group: os.killpg(group, signal.SIGKILL))
        left = {name: content for name, content in contents(merged).items() if not name.startswith(".")}
        whole = all(content in {old.get(name), new.get(name)} for name, content in left.items()) and "map.npz" in left
        if not (whole and run_program(merge.main, *words).code == 0 and contents(merged) == new):
            torn.append(state)
    happened = f"torn: {'; '.join(torn)}" if torn else "each file is whole, the old or the new; a rerun made the rest"
    return Outcome(happened, "everything" if torn else "nothing", survived=not torn)


def _signs(folder: Path) -> str:
    return tempfile.mkdtemp(dir=folder)


def _refused(folder: Path, begin: Callable[[WrittenMaps], ProgramRun], fact: str) -> Outcome:
    """Begin to write where it cannot be done: one line must say why, and the maps there are must stay."""
    maps = WrittenMaps(folder / "maps")
    done = begin(maps)
    kept = maps.are_whole() and (maps.out / "robot_0" / "map.npz").read_bytes() == maps.old["robot_0/map.npz"]
    right = kept and _as_wanted(done, 1, fact) and maps.run_again()
    return Outcome(_last_line(done, folder), "nothing" if right else "everything", survived=right)


def _on_a_full_disk(maps: WrittenMaps) -> ProgramRun:
    return run_child(build_maps, *maps.arguments(), largest_file=_FULL_AT)


def _into_a_read_only_folder(maps: WrittenMaps) -> ProgramRun:
    maps.out.chmod(0o555)
    try:
        return run_child(build_maps, *maps.arguments())
    finally:
        maps.out.chmod(0o755)


def _second_of_two(folder: Path) -> Outcome:
    """Start a second run into a folder while the first writes there."""
    maps = WrittenMaps(folder / "maps")
    second: list[ProgramRun] = []

    def begin_another(_: int) -> None:
        second.append(run_program(build_maps.main, *maps.arguments("--redo")))

    moment = Moment(str(maps.out / "robot_0" / "map.npz"), "whole", _signs(folder))
    first = run_child(build_maps, *maps.arguments(), at=moment, do=begin_another)
    refused = _as_wanted(second[0], 1, "another run is writing there")
    right = refused and first.code == 0 and contents(maps.out) == maps.new
    return Outcome(_last_line(second[0], folder), "nothing" if right else "everything", survived=right)


def _changed_byte(folder: Path, name: str) -> Outcome:
    """Change a byte of a result: who reads it must notice, and a rerun must build it again."""
    maps = WrittenMaps(folder / "maps")
    maps.run_again()
    path = maps.out / "robot_1" / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF  # all its bits: of packed data one alone may come to the same
    path.write_bytes(content)
    read = run_program(merge.main, maps.out, "-o", folder / "merged")
    noticed = name != "map.npz" or _as_wanted(read, 1, "damaged")
    right = noticed and maps.run_again()
    happened = _last_line(read, folder) if name == "map.npz" else "noticed by a rerun, which built the map again"
    return Outcome(happened if right else "not noticed", "nothing" if right else "everything", survived=right)


def _as_wanted(done: ProgramRun, code: int, fact: str) -> bool:
    """Tell whether a program ended with a code, and, if it could speak, with a line about it that says a fact."""
    lines = done.stderr.splitlines() or [""]
    spoke = re.match("(build_maps|merge): ", lines[-1]) is not None and fact in lines[-1]
    return done.code == code and "Traceback" not in done.stderr and (code < 0 or spoke)


def _last_line(done: ProgramRun, folder: Path) -> str:
    lines = done.stderr.replace(f"{folder}/", "").strip().splitlines() or [""]
    return f"refused in one line: {shortened(lines[-1].split('; the first: ')[-1])}"


CASES = (
    FaultCase(
        "kill -9 while maps are written",
        partial(_stopped, send=signal.SIGKILL, code=-signal.SIGKILL, files=("map.npz", "map.pgm", "occupied.png")),
    ),
    FaultCase(
        "Ctrl-C while maps are written",
        partial(_stopped, send=signal.SIGINT, code=_INTERRUPTED, states=("half",)),
        quick=True,
    ),
    FaultCase(
        "Ctrl-C with two workers",
        partial(
            _stopped,
            send=signal.SIGINT,
            code=_INTERRUPTED,
            states=("half", "named"),
            words=("--workers", "2", "--redo"),
        ),
    ),
    FaultCase(
        "kill (SIGTERM) with two workers",
        partial(
            _stopped,
            send=signal.SIGTERM,
            code=128 + signal.SIGTERM,
            fact="terminated",
            states=("half",),
            words=("--workers", "2", "--redo"),
        ),
    ),
    FaultCase("kill -9 while a merged map is written", _merge_killed),
    FaultCase("full disk", partial(_refused, begin=_on_a_full_disk, fact="make room"), quick=True),
    FaultCase("read-only folder", partial(_refused, begin=_into_a_read_only_folder, fact="cannot be written into")),
    FaultCase("two runs into one folder", _second_of_two),
    FaultCase("a changed byte in map.npz", partial(_changed_byte, name="map.npz"), quick=True),
    FaultCase("a changed byte in trajectory.tum", partial(_changed_byte, name="trajectory.tum")),
)
