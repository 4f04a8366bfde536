"""Faults while results are written: each file stays the old one or is the new one, and a rerun goes on."""

import re
import signal
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from tools import build_maps, merge
from tools.fault_cases.child_run import is_being_written, run_child, until_caught
from tools.fault_cases.fault_case import FaultCase, Outcome
from tools.fault_cases.program_run import ProgramRun, run_program
from tools.fault_cases.written_maps import WrittenMaps, contents

_INTERRUPTED = 130
_FULL_AT = 10_000
"""Size at which the disk is full [B]: a picture of the maps is smaller, a map larger."""


def _stopped(
    folder: Path, send: signal.Signals, code: int, written: Iterable[str], words: Iterable[str] = ()
) -> Outcome:
    """Send build_maps a signal while it writes a file, for each of some files."""
    torn = []
    for name in written:
        maps, done = until_caught(partial(_disturbed, folder, name, send, tuple(words)))
        said = _as_wanted(done, code, "interrupted")
        if not (said and maps.are_whole() and maps.run_again()):
            torn.append(name if said else f"{name}: exit {done.code}, {done.stderr[-60:]!r}")
    happened = "torn: " + ", ".join(torn) if torn else "each file is whole, the old or the new; a rerun made the rest"
    return Outcome(happened, "everything" if torn else "nothing", survived=not torn)


def _disturbed(
    folder: Path, name: str, send: signal.Signals, words: tuple[str, ...], trial: int
) -> tuple[WrittenMaps, ProgramRun]:
    """Send build_maps a signal while it writes a file, in a folder for each trial."""
    maps = WrittenMaps(folder / f"{name}.{trial}")
    moment = is_being_written(maps.out / "robot_1", name)
    return maps, run_child(build_maps, *maps.arguments(*words), until=moment, send=send)


def _merge_killed(folder: Path, trial: int) -> Outcome:
    """Kill merge while it writes its map over an older one."""
    folder = folder / str(trial)
    maps = WrittenMaps(folder / "maps")
    for name, rule in (("merged", "disjunctive"), ("new", "conjunctive")):
        run_program(merge.main, maps.folder / "new", "--rule", rule, "-o", folder / name)
    old, new = contents(folder / "merged"), contents(folder / "new")
    words = (maps.folder / "new", "--rule", "conjunctive", "-o", folder / "merged")
    run_child(merge, *words, until=is_being_written(folder / "merged", "map.npz"))
    left = {name: content for name, content in contents(folder / "merged").items() if not name.startswith(".")}
    whole = all(content in {old.get(name), new.get(name)} for name, content in left.items()) and "map.npz" in left
    again = run_program(merge.main, *words).code == 0 and contents(folder / "merged") == new
    happened = "each file is whole, the old or the new; a rerun made the rest" if whole and again else "torn files"
    return Outcome(happened, "nothing" if whole and again else "everything", survived=whole and again)


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


def _second_of_two(folder: Path, trial: int) -> Outcome:
    """Start a second run into a folder while the first writes there."""
    folder = folder / str(trial)
    maps = WrittenMaps(folder / "maps")
    second: list[ProgramRun] = []

    def when_the_first_writes() -> bool:
        if is_being_written(maps.out / "robot_0", "map.npz")():
            second.append(run_program(build_maps.main, *maps.arguments("--redo")))
        return bool(second)

    first = run_child(build_maps, *maps.arguments(), until=when_the_first_writes, send=signal.SIGCONT)
    refused = _as_wanted(second[0], 1, "another run is writing there")
    right = refused and first.code == 0 and contents(maps.out) == maps.new
    return Outcome(_last_line(second[0], folder), "nothing" if right else "everything", survived=right)


def _changed_byte(folder: Path, name: str) -> Outcome:
    """Change a byte of a result: who reads it must notice, and a rerun must make it anew."""
    maps = WrittenMaps(folder / "maps")
    maps.run_again()
    path = maps.out / "robot_1" / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF  # all its bits: of packed data one alone may come to the same
    path.write_bytes(content)
    read = run_program(merge.main, maps.out, "-o", folder / "merged")
    noticed = name != "map.npz" or _as_wanted(read, 1, "damaged")
    right = noticed and maps.run_again()
    happened = _last_line(read, folder) if name == "map.npz" else "noticed by a rerun, which made the map anew"
    return Outcome(happened if right else "not noticed", "nothing" if right else "everything", survived=right)


def _as_wanted(done: ProgramRun, code: int, fact: str) -> bool:
    """Tell whether a program ended with a code, and, if it could speak, with a line about it that says a fact."""
    lines = done.stderr.splitlines() or [""]
    spoke = re.match("(build_maps|merge): ", lines[-1]) is not None and fact in lines[-1]
    return done.code == code and "Traceback" not in done.stderr and (code < 0 or spoke)


def _last_line(done: ProgramRun, folder: Path) -> str:
    lines = done.stderr.replace(f"{folder}/", "").strip().splitlines() or [""]
    return f"refused in one line: {lines[-1]}"[:150]


def _caught(attempt: Callable[[Path, int], Outcome]) -> Callable[[Path], Outcome]:
    return lambda folder: until_caught(partial(attempt, folder))


CASES = (
    FaultCase(
        "kill -9 while maps are written",
        partial(_stopped, send=signal.SIGKILL, code=-signal.SIGKILL, written=("map.npz", "map.pgm", "occupied.png")),
    ),
    FaultCase(
        "Ctrl-C while maps are written",
        partial(_stopped, send=signal.SIGINT, code=_INTERRUPTED, written=("map.npz",)),
        quick=True,
    ),
    FaultCase(
        "Ctrl-C with two workers",
        partial(
            _stopped, send=signal.SIGINT, code=_INTERRUPTED, written=("map.npz",), words=("--workers", "2", "--redo")
        ),
    ),
    FaultCase("kill -9 while a merged map is written", _caught(_merge_killed)),
    FaultCase("full disk", partial(_refused, begin=_on_a_full_disk, fact="make room"), quick=True),
    FaultCase("read-only folder", partial(_refused, begin=_into_a_read_only_folder, fact="cannot be written into")),
    FaultCase("two runs into one folder", _caught(_second_of_two)),
    FaultCase("a changed byte in map.npz", partial(_changed_byte, name="map.npz"), quick=True),
    FaultCase("a changed byte in trajectory.tum", partial(_changed_byte, name="trajectory.tum")),
)
