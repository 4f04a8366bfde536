"""What the SLAM costs and how good it is: every recording with every preset, each run in a process of its own."""

import argparse
import dataclasses
import json
import statistics
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tbmslam.io.atomic_file import write_text
from tools.benchmarks.measured_process import in_fresh_process
from tools.benchmarks.result_table import ResultTable, write_tables
from tools.benchmarks.simulated_recording import RecordingSpec
from tools.benchmarks.slam_run import WARM_UP_SCANS, SlamRun, run_slam
from tools.command_line.text_table import describe_machine, machine_line, number, text_table

LOST_M = 0.5
"""A drive with a larger error is lost."""

HEAD = (
    *("recording", "preset", "scans", "beams", "read/s", "match/s", "insert/s", "finish/s", "scans/s"),
    *("times real time", "peak MB", "mean error m", "mean error deg", "ATE m", "keyframes"),
)

SEEDS_HEAD = ("worlds", "preset", "seeds", f"lost (ATE above {LOST_M} m)", "median ATE m", "worst ATE m", "worst drive")

NOTES = f"""\
scans/s: scans per CPU second of the process in everything but reading. read/s, match/s, insert/s, finish/s: scans per
CPU second of that part alone (finish: closing loops and rendering). times real time: duration of the recording over the
time that passed, reading included. mean error: of the true relations. Warm-up: a run that is not counted fills
numba's cache; then each process maps the first {WARM_UP_SCANS} scans, and a short simulated drive, before its clocks
start, which loads the compiled code."""

TARGETS = {"viny": 1150.0, "viny-hc": 775.0}
"""Scans per CPU second at TARGET_BEAMS beams that the presets are held to: five times the original program's."""

TARGET_BEAMS = 1040


@dataclass(frozen=True)
class Entry:
    """A recording with the name it has in the table, and what it has in common with other seeds of a world."""

    name: str
    spec: RecordingSpec
    family: str | None = None


@dataclass(frozen=True)
class Result:
    """A recording mapped with a preset, once or several times."""

    recording: str
    preset: str
    median: SlamRun
    runs: tuple[SlamRun, ...]
    family: str | None = None


def benchmark_slam(args: argparse.Namespace) -> None:
    """Run what the arguments ask for and print the table."""
    machine = describe_machine()
    results: list[Result] = []
    for entry in _entries(args):
        if not results:
            for name in args.preset:
                _say(f"warm-up: {entry.name} {name}")
                in_fresh_process(run_slam, entry.spec, name)
        results += [_measured(entry, name, args.repeat) for name in args.preset]
    rows = [_row(result) for result in results]
    print(text_table(HEAD, rows))
    print(NOTES + (f" Medians of {args.repeat} runs." if args.repeat > 1 else ""))
    for line in against_targets(results):
        print(line)
    if (seeds := seeds_table(results)).rows:
        print(text_table(*seeds))
    print(machine_line(machine))
    tables = {"drives": ResultTable(HEAD, rows), "seeds": seeds, **by_preset(results)}
    write_tables(args.table, machine, tables)
    if args.json:
        record = {"machine": machine, "results": [dataclasses.asdict(result) for result in results]}
        write_text(args.json, json.dumps(record, indent=2) + "\n")


def median_run(runs: Sequence[SlamRun]) -> SlamRun:
    """Return the median of every figure; the errors are the same each time, as the SLAM is deterministic."""
    figures: dict[str, Any] = {}
    for field in fields(SlamRun):
        values = [getattr(run, field.name) for run in runs]
        figures[field.name] = None if None in values else statistics.median(values)
    return SlamRun(**figures)


def against_targets(results: Sequence[Result]) -> list[str]:
    """Return a line for every result that a target exists for."""
    return [
        f"{result.recording} {result.preset}: {_rate(result.median.scans, result.median.mapping_s)} scans per CPU "
        f"second, to be at least {TARGETS[result.preset]:.0f} at {TARGET_BEAMS} beams: "
        + ("met" if result.median.scans / result.median.mapping_s >= TARGETS[result.preset] else "MISSED")
        for result in results
        if result.preset in TARGETS and result.median.beams == TARGET_BEAMS
    ]


def seeds_table(results: Sequence[Result]) -> ResultTable:
    """Return a row for every family of worlds that was run with several seeds."""
    families: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for result in results:
        if result.family is not None and result.median.ate_m is not None:
            errors = families.setdefault((result.family, result.preset), [])
            errors.append((result.median.ate_m, result.recording))
    rows = []
    for (family, preset), errors in families.items():
        worst, name = max(errors)
        middle = statistics.median(error for error, _ in errors)
        lost = sum(error > LOST_M for error, _ in errors)
        if len(errors) > 1:
            rows.append([family, preset, str(len(errors)), str(lost), number(middle, 4), number(worst, 4), name])
    return ResultTable(SEEDS_HEAD, rows)


def by_preset(results: Sequence[Result]) -> dict[str, ResultTable]:
    """Return tables of errors and of scans per CPU second with a row a preset and a column a recording."""
    recordings = [*dict.fromkeys(result.recording for result in results)]
    presets = [*dict.fromkeys(result.preset for result in results)]
    medians = {(result.preset, result.recording): result.median for result in results}
    tables = {}
    for name, cell in (("errors", _error), ("speeds", lambda run: _rate(run.scans, run.mapping_s))):
        rows = [[preset, *(cell(medians[preset, recording]) for recording in recordings)] for preset in presets]
        tables[name] = ResultTable(("preset", *recordings), rows)
    return tables


def _entries(args: argparse.Namespace) -> Iterator[Entry]:
    """Yield the recordings, simulated ones while they are needed."""
    for spec in args.recordings:
        yield Entry(_short_name(spec.path), spec)
    for world in (world for first in args.world for world in first.seeds(args.seeds)):
        _say(f"simulating {world}")
        with tempfile.TemporaryDirectory(prefix="benchmark-") as folder:
            yield Entry(str(world), world.write(Path(folder)), world.family())


def _measured(entry: Entry, preset_name: str, repeat: int) -> Result:
    runs = []
    for turn in range(repeat):
        _say(f"{entry.name} {preset_name}" + (f" {turn + 1}/{repeat}" if repeat > 1 else ""))
        runs.append(in_fresh_process(run_slam, entry.spec, preset_name))
    return Result(entry.name, preset_name, median_run(runs), tuple(runs), entry.family)


def _row(result: Result) -> list[str]:
    run = result.median
    parts = (run.reading_s, run.matching_s, run.inserting_s, run.finishing_s, run.mapping_s)
    return [
        result.recording,
        result.preset,
        str(run.scans),
        str(run.beams),
        *(_rate(run.scans, seconds) for seconds in parts),
        number(run.duration_s / run.wall_s, 0),
        number(run.peak_memory_mb, 0),
        number(run.translation_error_m, 4),
        number(run.rotation_error_deg, 3),
        number(run.ate_m, 4),
        str(run.keyframes),
    ]


def _error(run: SlamRun) -> str:
    """Return the mean error of relations, else the ATE, in metres."""
    error_m = run.translation_error_m if run.translation_error_m is not None else run.ate_m
    return number(error_m, 4)


def _rate(scans: float, seconds: float) -> str:
    return number(scans / seconds, 0) if seconds > 0.0 else "-"


def _short_name(path: Path) -> str:
    return path.name.removesuffix(".bag")


def _say(text: str) -> None:
    """Show the progress on stderr."""
    sys.stderr.write(f"benchmark: {text}\n")
