"""Costs and errors of the SLAM: every recording with every preset, each run in a process of its own."""

import argparse
import gc
import itertools
import statistics
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from datasets import open_recording
from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import EndlessDrive, OdometryNoise
from tbmslam.configuration.slam_config import SlamConfig, preset
from tbmslam.evaluation.relation_cycles import relation_noise
from tbmslam.evaluation.relations import read_relations, relation_errors
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.io.trajectory_file import read_reference
from tbmslam.map.drive import Drive
from tbmslam.sensing.laser_scan import Reading
from tbmslam.slam import Slam
from tools.benchmarks.measured_process import in_fresh_process, peak_memory_mb
from tools.benchmarks.recordings import RecordingSpec, beside
from tools.command_line.measurement_record import finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table

WARM_UP_SCANS = 20
"""Scans of a recording that are mapped before the measurement."""

_ROUND_M = 130.0  # once around a block and on, so that a loop is closed


def warm_up(config: SlamConfig, readings: Iterable[Reading]) -> None:
    """Map the first scans of a recording, and a short simulated drive that closes a loop.

    The living objects are excluded from garbage collection, as in `tools.command_line.program`.
    """
    angle_min, angle_increment = SimulatedLaser.field_of(91)
    laser = SimulatedLaser(beams=91, angle_min=angle_min, angle_increment=angle_increment, rate=2.0)
    drive = EndlessDrive("round", _ROUND_M, laser, OdometryNoise.preset("poor"))
    for each in (islice(readings, WARM_UP_SCANS), drive.readings()):
        slam = Slam(config)
        for reading in each:
            slam.process(reading)
        slam.finish()
    gc.freeze()


_BLOCK = 50  # readings between two reads of the CPU clock, which take a microsecond each


@dataclass(frozen=True)
class SlamRun:
    """Figures of one run over one recording."""

    scans: int
    beams: int
    keyframes: int
    """Numbers of scans, of beams of the largest scan, and of keyframes."""
    duration_s: float
    reading_s: float
    """CPU time of reading the recording."""
    mapping_s: float
    """CPU time of everything else, including the following."""
    finishing_s: float
    """CPU time of the end of the drive."""
    wall_s: float
    """Wall time from the first scan to the map."""
    peak_memory_mb: float
    translation_error_m: float | None = None
    rotation_error_deg: float | None = None
    """Mean errors against the relations beside the recording; None without."""
    relation_noise_m: float | None = None
    relation_noise_deg: float | None = None
    """Mean errors of these relations themselves; None with too few cycles, or if they close exactly."""
    ate_m: float | None = None
    """Error against the true trajectory beside the recording; None without."""


class CpuClock:
    """Measures the CPU time of this process by activity [s]."""

    def __init__(self) -> None:
        self.cpu = dict.fromkeys(("reading", "processing", "finishing"), 0.0)

    @contextmanager
    def during(self, activity: str) -> Iterator[None]:
        """Add the time of the block."""
        cpu = time.process_time()
        yield
        self.cpu[activity] += time.process_time() - cpu


def run_slam(spec: RecordingSpec, preset_name: str) -> SlamRun:
    """Map a recording in this process and measure it."""
    config = preset(preset_name)
    recording = open_recording([spec.path], spec.options)
    warm_up(config, recording)
    slam, clock, beams, began = Slam(config), CpuClock(), 0, time.perf_counter()
    for block in _blocks(recording, clock):
        with clock.during("processing"):
            for reading in block:
                slam.process(reading)
        beams = max(beams, *(len(reading.scan.ranges) for reading in block))
    with clock.during("finishing"):
        drive = slam.finish().drives[0]
    trajectory = drive.trajectory
    return SlamRun(
        scans=len(trajectory),
        beams=beams,
        keyframes=len(drive.keyframes),
        duration_s=float(np.ptp(trajectory.stamps)),
        reading_s=clock.cpu["reading"],
        mapping_s=clock.cpu["processing"] + clock.cpu["finishing"],
        finishing_s=clock.cpu["finishing"],
        wall_s=time.perf_counter() - began,
        peak_memory_mb=peak_memory_mb(),
        **_errors(spec, drive),
    )


def _blocks(readings: Iterable[Reading], clock: CpuClock) -> Iterator[list[Reading]]:
    """Yield the readings in blocks, and measure the time of reading."""
    iterator = iter(readings)
    while True:
        with clock.during("reading"):
            block = list(itertools.islice(iterator, _BLOCK))
        if not block:
            return
        yield block


def _errors(spec: RecordingSpec, drive: Drive) -> dict[str, float | None]:
    """Return the errors against the truth beside the recording."""
    trajectory = drive.trajectory
    errors: dict[str, float | None] = {}
    if (path := beside(spec.path, ".relations")) is not None:
        relations = read_relations(path)
        against = relation_errors(relations, trajectory)
        if len(against.translations_m):
            errors["translation_error_m"] = float(against.translations_m.mean())
            errors["rotation_error_deg"] = float(against.rotations_deg.mean())
        if (noise := relation_noise(relations)) is not None:
            errors["relation_noise_m"], errors["relation_noise_deg"] = noise.translation_m, noise.rotation_deg
    path = beside(spec.path, ".truth.tum") or beside(spec.path, ".gt.laser.poses")
    if path is not None:
        truth = read_reference(path).of_robot(drive.keyframes.mounting())
        errors["ate_m"] = align_trajectories(truth, trajectory).ate_m
    return errors


LOST_M = 0.5
"""A drive with a larger error is lost."""

NOTES = f"""\
scans/s: scans per CPU second, without reading. read/s, finish/s: scans per CPU second of reading, and of the end (loop
closing, rendering). times real time: duration of the recording divided by the wall time, including reading. mean error:
of the true relations. relation noise: mean error of the relations in cycles, estimated from the errors of the cycles.
A first run, which is not counted, fills numba's cache. Each process first maps {WARM_UP_SCANS} scans and a short
simulated drive, which loads the compiled code."""


@dataclass(frozen=True)
class Entry:
    """A recording with its name in the table, and the family of worlds with other seeds."""

    name: str
    spec: RecordingSpec
    family: str | None = None


@dataclass(frozen=True)
class Result:
    """One or several runs of a recording with a preset."""

    recording: str
    preset: str
    median: SlamRun
    runs: tuple[SlamRun, ...]
    family: str | None = None


def benchmark_slam(args: argparse.Namespace) -> None:
    """Run the benchmark and print the tables."""
    results: list[Result] = []
    for entry in _entries(args):
        if not results:
            for name in args.preset:
                say(f"benchmark: warm-up: {entry.name} {name}")
                in_fresh_process(run_slam, entry.spec, name)
        results += [_measured(entry, name, args.repeat) for name in args.preset]
    drives = ResultTable.of([_row(result) for result in results])
    print(text_table(*drives))
    print(NOTES + (f" Medians of {args.repeat} runs (the lower of two)." if args.repeat > 1 else ""))
    if (seeds := seeds_table(results)).rows:
        print(text_table(*seeds))
    tables = {"drives": drives, "seeds": seeds, **by_preset(results)}
    finish(args, tables, {"results": results})


def median_run(runs: Sequence[SlamRun]) -> SlamRun:
    """Return the median of every figure, and the lower of two middle ones.

    The errors of all runs are equal, since the SLAM is deterministic.
    """
    figures: dict[str, Any] = {}
    for field in fields(SlamRun):
        values = [getattr(run, field.name) for run in runs]
        figures[field.name] = None if None in values else statistics.median_low(values)
    return SlamRun(**figures)


def seeds_table(results: Sequence[Result]) -> ResultTable:
    """Return a row for every world that was run with several seeds."""
    families: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for result in results:
        if result.family is not None and result.median.ate_m is not None:
            errors = families.setdefault((result.family, result.preset), [])
            errors.append((result.median.ate_m, result.recording))
    rows = []
    for (family, preset_name), errors in families.items():
        worst, name = max(errors)
        middle = statistics.median(error for error, _ in errors)
        lost = sum(error > LOST_M for error, _ in errors)
        if len(errors) > 1:
            row = {
                "worlds": family,
                "preset": preset_name,
                "seeds": str(len(errors)),
                f"lost (ATE above {LOST_M} m)": str(lost),
                "median ATE m": number(middle, 4),
                "worst ATE m": number(worst, 4),
                "worst drive": name,
            }
            rows.append(row)
    return ResultTable.of(rows)


def by_preset(results: Sequence[Result]) -> dict[str, ResultTable]:
    """Return tables of errors and of speeds, with a row for each preset and a column for each recording."""
    recordings = [*dict.fromkeys(result.recording for result in results)]
    presets = [*dict.fromkeys(result.preset for result in results)]
    medians = {(result.preset, result.recording): result.median for result in results}
    tables = {}
    for name, cell in (("errors", _error), ("speeds", lambda run: _rate(run.scans, run.mapping_s))):
        rows = [[preset, *(cell(medians[preset, recording]) for recording in recordings)] for preset in presets]
        tables[name] = ResultTable(("preset", *recordings), rows)
    return tables


def _entries(args: argparse.Namespace) -> Iterator[Entry]:
    """Yield the recordings; a simulated one exists until the next is requested."""
    for spec in args.recordings:
        yield Entry(spec.name, spec)
    for world in (world for first in args.world for world in first.seeds(args.seeds)):
        say(f"benchmark: simulating {world}")
        with tempfile.TemporaryDirectory(prefix="benchmark-") as folder:
            yield Entry(str(world), world.write(Path(folder)), world.family())


def _measured(entry: Entry, preset_name: str, repeat: int) -> Result:
    runs = []
    for turn in range(repeat):
        say(f"benchmark: {entry.name} {preset_name}" + (f" {turn + 1}/{repeat}" if repeat > 1 else ""))
        runs.append(in_fresh_process(run_slam, entry.spec, preset_name))
    return Result(entry.name, preset_name, median_run(runs), tuple(runs), entry.family)


def _row(result: Result) -> dict[str, str]:
    run = result.median
    return {
        "recording": result.recording,
        "preset": result.preset,
        "scans": str(run.scans),
        "beams": str(run.beams),
        "read/s": _rate(run.scans, run.reading_s),
        "finish/s": _rate(run.scans, run.finishing_s),
        "scans/s": _rate(run.scans, run.mapping_s),
        "times real time": number(run.duration_s / run.wall_s, 0),
        "peak MB": number(run.peak_memory_mb, 0),
        "mean error m": number(run.translation_error_m, 4),
        "mean error deg": number(run.rotation_error_deg, 3),
        "relation noise m": number(run.relation_noise_m, 4),
        "relation noise deg": number(run.relation_noise_deg, 3),
        "ATE m": number(run.ate_m, 4),
        "keyframes": str(run.keyframes),
    }


def _error(run: SlamRun) -> str:
    """Return the mean error of relations, else the ATE, in metres."""
    error_m = run.translation_error_m if run.translation_error_m is not None else run.ate_m
    return number(error_m, 4)


def _rate(scans: float, seconds: float) -> str:
    return number(scans / seconds, 0) if seconds > 0.0 else "-"
