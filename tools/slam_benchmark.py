"""What the SLAM costs and how good it is: every recording with every preset, each run in a process of its own."""

import argparse
import contextlib
import dataclasses
import json
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tbmslam.atomic_file import write_text
from tbmslam.errors import TbmSlamError
from tools import make_world
from tools.machine import describe_machine
from tools.measured_process import in_fresh_process
from tools.recording_spec import RecordingSpec, as_words, parse_recording_spec
from tools.slam_run import WARM_UP_SCANS, SlamRun, run_slam
from tools.text_table import number, text_table

HEAD = (
    *("recording", "preset", "scans", "beams", "read/s", "match/s", "insert/s", "finish/s", "scans/s", "real time"),
    *("peak MB", "trans m", "rot deg", "ATE m", "keyframes"),
)

NOTES = f"""\
scans/s: scans per CPU second of the process in everything but reading. read/s, match/s, insert/s, finish/s: scans per
CPU second of that part alone (finish: closing loops and rendering). real time: duration of the recording over the time
that passed, reading included. trans m, rot deg: mean errors of relations. Warm-up: a run that is not counted fills
numba's cache; then each process maps the first {WARM_UP_SCANS} scans once before its clocks start, which loads the
compiled code."""

TARGETS = {"viny": 1150.0, "viny-hc": 775.0}
"""Scans per CPU second at TARGET_BEAMS beams that the presets are held to: five times the original program's."""


TARGET_BEAMS = 1040


class SimulationError(TbmSlamError):
    """A world could not be simulated."""


@dataclass(frozen=True)
class Entry:
    """A recording with the name it has in the table."""

    name: str
    spec: RecordingSpec


@dataclass(frozen=True)
class Result:
    """A recording mapped with a preset, once or several times."""

    recording: str
    preset: str
    median: SlamRun
    runs: tuple[SlamRun, ...]


def benchmark_slam(args: argparse.Namespace) -> None:
    """Run what the arguments ask for and print the table."""
    machine = describe_machine()
    with tempfile.TemporaryDirectory(prefix="benchmark-") as folder:
        entries = [Entry(_short_name(spec.path), spec) for spec in args.recordings]
        entries += [_simulated(world, Path(folder) / str(index)) for index, world in enumerate(args.world)]
        for preset_name in args.preset:
            _say(f"warm-up: {entries[0].name} {preset_name}")
            in_fresh_process(run_slam, entries[0].spec, preset_name)
        results = [_measured(entry, name, args.repeat) for entry in entries for name in args.preset]
    print(text_table(HEAD, [_row(result) for result in results]))
    print(NOTES + (f" Medians of {args.repeat} runs." if args.repeat > 1 else ""))
    for line in against_targets(results):
        print(line)
    print(", ".join(f"{key} {value}" for key, value in machine.items()))
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


def _measured(entry: Entry, preset_name: str, repeat: int) -> Result:
    runs = []
    for turn in range(repeat):
        _say(f"{entry.name} {preset_name}" + (f" {turn + 1}/{repeat}" if repeat > 1 else ""))
        runs.append(in_fresh_process(run_slam, entry.spec, preset_name))
    return Result(entry.name, preset_name, median_run(runs), tuple(runs))


def _simulated(world: str, folder: Path) -> Entry:
    """Write a bag of a simulated drive and its truth, described as ``office:1:good[,option=value]...``."""
    description, *settings = world.split(",")
    kind, seed, odometry = description.split(":")
    words = ["--world", kind, "--seed", seed, "--odometry", odometry, "--out", str(folder), *as_words(settings)]
    _say(f"simulating {world}")
    with contextlib.redirect_stdout(sys.stderr):
        code = make_world.main(words)
    if code:
        raise SimulationError(f"{world} could not be simulated: see the message above")
    return Entry(world, parse_recording_spec(str(folder / "robot_0.bag")))


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


def _rate(scans: float, seconds: float) -> str:
    return number(scans / seconds, 0) if seconds > 0.0 else "-"


def _short_name(path: Path) -> str:
    return path.name.removesuffix(".bag")


def _say(text: str) -> None:
    """Tell who waits what is going on."""
    sys.stderr.write(f"benchmark: {text}\n")
