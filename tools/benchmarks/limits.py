"""Whether the longest recordings and the largest buildings that are promised fit into the memory that is promised."""

import argparse
import dataclasses
import json
import sys
from typing import NamedTuple

from datasets.synthetic.robot.endless_drive import Route
from tbmslam.io.atomic_file import write_text
from tools.benchmarks.measured_process import MeasurementError, in_fresh_process
from tools.benchmarks.result_table import ResultTable, write_tables
from tools.benchmarks.scaling import ScalingRun, run_scaling
from tools.command_line.text_table import describe_machine, machine_line, number, text_table

HEAD = ("what", "drive", "scans", "seen m2", "box m2", "CPU s", "peak MB", "ATE m", "within 2000 MB")

_PROMISED_MB = 2000.0
_SPEED = 0.455  # [m/s], of `EndlessDrive` round a block, corners and all
_BEAMS = 180


class Limit(NamedTuple):
    """A drive to be survived: what it stands for, its route, its length [m] and its scans a second [Hz]."""

    name: str
    route: Route
    length: float
    rate: float


LIMITS = (
    Limit("24 hours, a scan a second, round a block", "round", 24.0 * 3600.0 * _SPEED, 1.0),
    Limit("1 km2 of building, 10 km", "spiral", 10_000.0, 5.0),
)


def benchmark_limits(args: argparse.Namespace) -> None:
    """Drive as far as promised, or the share of it that the arguments ask for, and print the table."""
    machine, rows, runs = describe_machine(), [], []
    for limit in LIMITS:
        sys.stderr.write(f"benchmark: {limit.name}\n")
        length = args.share * limit.length
        try:
            run = in_fresh_process(run_scaling, "default", limit.route, length, _BEAMS, limit.rate)
        except MeasurementError as error:
            rows.append([limit.name, f"{length:.0f} m", *["-"] * 6, f"no: {error}"])
            continue
        runs.append({"name": limit.name, **dataclasses.asdict(run)})
        rows.append(_row(limit.name, run))
    print(text_table(HEAD, rows))
    print(machine_line(machine))
    write_tables(args.table, machine, {"limits": ResultTable(HEAD, rows)})
    if args.json:
        write_text(args.json, json.dumps({"machine": machine, "runs": runs}, indent=2) + "\n")


def _row(name: str, run: ScalingRun) -> list[str]:
    seconds = (run.scan_us + run.finishing_us) * run.scans / 1e6
    return [
        name,
        f"{run.length_m:.0f} m",
        str(run.scans),
        number(run.seen_m2, 0),
        number(run.box_m2, 0),
        number(seconds, 0),
        number(run.peak_memory_mb, 0),
        number(run.ate_m, 3),
        "yes" if run.peak_memory_mb <= _PROMISED_MB else "NO",
    ]
