"""Cost and memory of long drives and large maps, each run in its own process, and the check of the promised limits."""

import argparse
import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from datasets.synthetic.robot.laser import SimulatedLaser
from datasets.synthetic.robot.simulation import ROUTES, EndlessDrive, OdometryNoise, Route
from tbmslam.configuration.slam_config import preset
from tbmslam.errors import TbmSlamError
from tbmslam.evaluation.trajectory_errors import align_trajectories
from tbmslam.slam import Slam
from tools.benchmarks.measured_process import forget_peak_memory, in_fresh_process, peak_memory_mb
from tools.benchmarks.slam import CpuClock, warm_up
from tools.command_line.measurement_record import finish
from tools.command_line.program import say
from tools.command_line.text_table import ResultTable, number, text_table

NOTES = """\
round: around one block repeatedly; spiral: outwards, nothing is seen twice. CPU microseconds per scan of the
whole drive, of its last quarter, and of the end (closing loops, rendering). With thousands of keyframes, loops are also
closed during the drive."""

_SCAN_RATE = 5.0  # [Hz]: a scan every 10 cm or so
_BLOCK = 50
_BEAMS = 180


@dataclass(frozen=True)
class ScalingRun:
    """Figures of one drive."""

    route: str
    preset: str
    """Kind of route, and preset of the SLAM."""
    length_m: float
    scans: int
    """Length of the drive, and number of scans."""
    seen_m2: float
    box_m2: float
    """Final area of the known cells, and of their bounding box."""
    cell_m: float
    """Final side of a cell."""
    scan_us: float
    last_quarter_us: float
    finishing_us: float
    """CPU time per scan; see NOTES."""
    driven_memory_mb: float
    peak_memory_mb: float
    """Peak memory of the process until the end of the drive, including the simulated scans, and in all."""
    ate_m: float


def benchmark_scaling(args: argparse.Namespace) -> None:
    """Run the benchmark and print the table."""
    runs, failures = [], []
    for preset_name, route, length in itertools.product(args.preset, ROUTES, args.lengths):
        label = f"{route} {preset_name} {length:g} m"
        say(f"benchmark: {label}")
        try:
            runs.append(in_fresh_process(run_scaling, preset_name, route, length, _BEAMS))
        except (TbmSlamError, MemoryError) as error:
            failures.append(f"{label}: {error}")
    table = ResultTable.of([_row(run) for run in runs])
    print(text_table(*table))
    print(NOTES)
    for failure in failures:
        print(failure)
    finish(args, {"drives": table}, {"runs": runs, "failures": failures})


def run_scaling(preset_name: str, route: Route, length: float, beams: int, rate: float = _SCAN_RATE) -> ScalingRun:
    """Drive and map in this process at a scan rate [Hz], and measure it."""
    config = preset(preset_name)
    angle_min, angle_increment = SimulatedLaser.field_of(beams)
    laser = SimulatedLaser(beams=beams, angle_min=angle_min, angle_increment=angle_increment, rate=rate)
    drive = EndlessDrive(route, length, laser, OdometryNoise.preset("good"))
    warm_up(config, drive.readings())
    forget_peak_memory()  # of planning the drive, and of compiling
    slam, clock, stops = Slam(config), CpuClock(), [(0, 0.0)]
    readings = drive.readings()
    while block := list(itertools.islice(readings, _BLOCK)):
        with clock.during("processing"):
            for reading in block:
                slam.process(reading)
        stops.append((stops[-1][0] + len(block), clock.cpu["processing"]))
    driven_memory_mb = peak_memory_mb()
    with clock.during("finishing"):
        tbm_map = slam.finish()
    trajectory, geometry = tbm_map.drives[0].trajectory, tbm_map.grid.geometry
    micro = 1e6 / len(trajectory)
    return ScalingRun(
        route=route,
        preset=preset_name,
        length_m=length,
        scans=len(trajectory),
        seen_m2=tbm_map.grid.known_m2(),
        box_m2=geometry.rows * geometry.cols * geometry.resolution**2,
        cell_m=geometry.resolution,
        scan_us=clock.cpu["processing"] * micro,
        last_quarter_us=last_quarter_us(stops),
        finishing_us=clock.cpu["finishing"] * micro,
        driven_memory_mb=driven_memory_mb,
        peak_memory_mb=peak_memory_mb(),
        ate_m=align_trajectories(drive.truth(), trajectory).ate_m,
    )


def last_quarter_us(stops: Sequence[tuple[int, float]]) -> float:
    """Return the CPU time per scan of the last quarter [us]; stops are the scans and CPU seconds at each block's end.

    The first stop is the start of the drive.
    """
    (from_scan, from_cpu), (scans, cpu) = stops[(len(stops) - 1) * 3 // 4], stops[-1]
    return (cpu - from_cpu) / (scans - from_scan) * 1e6


def _row(run: ScalingRun) -> dict[str, str]:
    return {
        "route": run.route,
        "preset": run.preset,
        "drive m": number(run.length_m, 0),
        "scans": str(run.scans),
        "seen m2": number(run.seen_m2, 0),
        "box m2": number(run.box_m2, 0),
        "cell m": number(run.cell_m, 2),
        "scan us": number(run.scan_us, 0),
        "last us": number(run.last_quarter_us, 0),
        "finish us": number(run.finishing_us, 0),
        "driven MB": number(run.driven_memory_mb, 0),
        "peak MB": number(run.peak_memory_mb, 0),
        "ATE m": number(run.ate_m, 3),
    }


_PROMISED_MB = 2000.0
_SPEED = 0.455  # [m/s], of `EndlessDrive` round a block, corners and all


class Limit(NamedTuple):
    """A drive of promised size: its name, route, length [m] and scan rate [Hz]."""

    name: str
    route: Route
    length: float
    rate: float


LIMITS = (
    Limit("24 hours, a scan a second, round a block", "round", 24.0 * 3600.0 * _SPEED, 1.0),
    Limit("1 km2 of building, 10 km", "spiral", 10_000.0, 5.0),
)


def benchmark_limits(args: argparse.Namespace) -> None:
    """Map drives of the promised size, or of the given share of it, and print the table."""
    rows, runs = [], []
    for limit in LIMITS:
        say(f"benchmark: {limit.name}")
        length = args.share * limit.length
        try:
            run = in_fresh_process(run_scaling, "default", limit.route, length, _BEAMS, limit.rate)
        except (TbmSlamError, MemoryError) as error:
            rows.append(_limit_row(limit.name, length, None, f"no: {error}"))
            continue
        runs.append({"name": limit.name, **dataclasses.asdict(run)})
        rows.append(_limit_row(limit.name, length, run, "yes" if run.peak_memory_mb <= _PROMISED_MB else "NO"))
    table = ResultTable.of(rows)
    print(text_table(*table))
    finish(args, {"limits": table}, {"runs": runs})


def _limit_row(name: str, length: float, run: ScalingRun | None, verdict: str) -> dict[str, str]:
    return {
        "what": name,
        "drive": f"{length:.0f} m",
        "scans": str(run.scans) if run else "-",
        "seen m2": number(run.seen_m2 if run else None, 0),
        "box m2": number(run.box_m2 if run else None, 0),
        "CPU s": number((run.scan_us + run.finishing_us) * run.scans / 1e6 if run else None, 0),
        "peak MB": number(run.peak_memory_mb if run else None, 0),
        "ATE m": number(run.ate_m if run else None, 3),
        "within 2000 MB": verdict,
    }
